"""MuJoCo, or how to install it."""

from pushgraph.extras import extra

with extra("sim", "simulation"):
    import mujoco

__all__ = ["mujoco"]
