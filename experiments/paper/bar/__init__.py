"""The frontal impact of a ball on a free bar, from a model of its own: the true motion behind figures 8 to 12.

A free-free Euler-Bernoulli bar by modal superposition (`beam`) that yields in bending, a local elasto-plastic contact
(`contact`) with Coulomb's friction, a rigid ball. `impact` integrates them, `history` holds what comes out, `table`
writes the motion for a renderer, and all numbers stand in `setup`. No curve of the paper is drawn or fitted, and
nothing comes from the package under test.
"""
