"""Before the test: what a camera, a ball and a speed will give (the paper's sections 3 and 5.2)."""
