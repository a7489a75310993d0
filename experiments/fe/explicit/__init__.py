"""A small explicit solver for impacts of a rigid ball: what CalculiX lacks is Johnson and Cook's rate and heat.

`johnson_cook` is the metal, `elements` the brick, `sphere_contact` the ball, and `solver` integrates them by central
differences. Loops are compiled by Numba and use one thread. Units are mm, t, s, K, and so N, MPa and mJ. Nothing comes
from the package under test.
"""
