"""Explicit finite elements for the two impacts of the paper: a solver of our own, and CalculiX as a cross-check.

`explicit` is the solver, with Johnson and Cook's rate and heat; `validation` compares it with theory. For CalculiX,
`hardening` tabulates Johnson and Cook, `mesh` and `shapes` make the bricks, `deck` writes the input, `cases` holds the
parameters of both impacts, `run` starts `ccx`, and `read` turns what it printed into the ball's velocity and the force.
Used by `experiments.fe.bar` and `experiments.fe.plate`. Units are mm, t, s, and so N and MPa. Nothing comes from the
package under test.
"""
