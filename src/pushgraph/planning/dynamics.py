"""What plans are tried with: scenes with pushes in, tracks out; learned or simulated."""

from collections.abc import Callable, Sequence

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from pushgraph.errors import SimulationError
from pushgraph.joint_doubt import Beliefs
from pushgraph.physics import PhysicsPredictor
from pushgraph.scene import Scene
from pushgraph.track import Track

Dynamics = Callable[[Sequence[Scene]], Sequence[Track]]
"""Says what the pushes of each scene do. Scenes may differ in their tools and pushes; tracks may differ in length."""


def learned(predictor: PhysicsPredictor, spread: bool = False, beliefs: Beliefs | None = None) -> Dynamics:
    """Predict all plans side by side, those that begin alike once.

    spread: whether tracks say how far off they may be. beliefs: what is believed of the joints of pairs, which widens
    the spread.
    """

    def predict(scenes: Sequence[Scene]) -> Sequence[Track]:
        of_each = None if beliefs is None else [beliefs] * len(scenes)
        return predictor.predict_many(scenes, spread=spread, beliefs=of_each, share=True)

    return predict


def simulated(scenes: Sequence[Scene]) -> Sequence[Track]:
    """Simulate one plan after the other in MuJoCo; one that cannot be simulated leaves everything where it is."""
    return [_simulated(scene) for scene in scenes]


def _simulated(scene: Scene) -> Track:
    from pushgraph.simulation.planar import simulate  # here, so that plans of what is learned do without MuJoCo

    try:
        return simulate(scene)
    except SimulationError:
        return simulate(scene.model_copy(update={"pushes": ()}))


def body_poses(tracks: Sequence[Track]) -> Float[Tensor, "plans frames bodies 3"]:
    """pose_world_from_body in every frame; shorter tracks stay as they end."""
    longest = max(len(track.times) for track in tracks)
    padded = [np.concatenate((t.poses[:, 1:], np.repeat(t.poses[-1:, 1:], longest - len(t.times), 0))) for t in tracks]
    return torch.from_numpy(np.stack(padded))
