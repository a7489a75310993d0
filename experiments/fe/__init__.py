"""Explicit finite elements for the two impacts of the paper, by CalculiX.

`hardening` tabulates Johnson and Cook, `mesh` and `shapes` make the bricks, `deck` writes the input, `cases` holds the
parameters of both impacts, `run` starts `ccx`, and `read` turns what it printed into the ball's velocity and the force.
Used by `experiments.fe.bar` and `experiments.fe.plate`.
Units are mm, t, s, and so N and MPa. Nothing comes from the package under test.
"""
