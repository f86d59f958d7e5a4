"""What is seen in the browser: scenes, tracks, beliefs and plans as nodes of a viser scene."""

from pushgraph.view.drawing.scene_drawing import SceneDrawing

__all__ = ["SceneDrawing"]
