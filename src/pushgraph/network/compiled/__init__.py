"""The solves of `pushgraph.network`, one scene after the other, compiled for processors.

It computes what `contact_graph`, `contact_problem` and `newton` compute, and in space `contact_patch`, `body_problem`
and `body_step`, with the same names, equations and constants; those remain for graphics processors, gradients and
corrections. Tests hold the two together.
"""
