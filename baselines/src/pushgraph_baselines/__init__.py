"""Weights of the networks of Tekden et al. (2021) that pushgraph is measured against; `pushgraph` finds them here."""
