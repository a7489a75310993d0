"""Before the test: the precision to expect of a camera, a ball and a speed (the paper's sections 3 and 5.2)."""
