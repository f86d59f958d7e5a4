"""What plans are tried with: scenes with pushes in, tracks out; learned or simulated."""

from collections.abc import Callable, Sequence

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from pushgraph.physics import PhysicsPredictor
from pushgraph.scene import Scene
from pushgraph.simulation.planar import simulate
from pushgraph.track import Track

Dynamics = Callable[[Sequence[Scene]], Sequence[Track]]
"""Says what the pushes of each scene do. Scenes may differ in their tools and pushes; tracks may differ in length."""


def learned(predictor: PhysicsPredictor, spread: bool = False) -> Dynamics:
    """Predict all plans side by side, those that begin alike once.

    spread: whether tracks say how far off they may be.
    """
    return lambda scenes: predictor.predict_many(scenes, spread=spread, share=True)


def simulated(scenes: Sequence[Scene]) -> Sequence[Track]:
    """Simulate one plan after the other in MuJoCo."""
    return [simulate(scene) for scene in scenes]


def body_poses(tracks: Sequence[Track]) -> Float[Tensor, "plans frames bodies 3"]:
    """pose_world_from_body in every frame; shorter tracks stay as they end."""
    longest = max(len(track.times) for track in tracks)
    padded = [np.concatenate((t.poses[:, 1:], np.repeat(t.poses[-1:, 1:], longest - len(t.times), 0))) for t in tracks]
    return torch.from_numpy(np.stack(padded))
