"""pushgraph: a learned physics engine for robot pushing."""
