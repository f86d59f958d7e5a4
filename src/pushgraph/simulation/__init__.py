"""Pushes in a physics engine; the only room that knows MuJoCo."""
