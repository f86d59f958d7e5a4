"""The noise floor: the simulator against itself, started a little beside the truth.

Pushing is chaotic, so no predictor that sees the start with some noise can do better than this.
"""

from typing import NamedTuple

import numpy as np

from pushgraph import pose
from pushgraph.errors import SceneError, SimulationError
from pushgraph.scene import Scene
from pushgraph.scene_at import scene_at
from pushgraph.simulation.motion import LIFTED_FRAMES
from pushgraph.simulation.planar import simulate
from pushgraph.track import Track

ATTEMPTS = 200


class StartNoise(NamedTuple):
    """Standard deviations of the noise on the start of every body."""

    position: float
    """m, along x and along y"""
    yaw: float
    """rad"""


CAMERA = StartNoise(1e-3, np.radians(0.5))
"""What a tag camera sees; the noise floor of the evaluations."""


def simulate_again(track: Track, frames: int, noise: StartNoise, rng: np.random.Generator) -> Track | None:
    """Simulate the pushes that begin in the first `frames` frames again, from a noisy start.

    None if a tool would come down on a body that the noise has led elsewhere.
    """
    # Frames of the lifted tool exist only before a push, so a stretch that ends in them needs the next push.
    begun = int(track.push[: frames + LIFTED_FRAMES].max()) + 1
    scene = track.scene.replace(pushes=track.scene.pushes[:begun])
    for _ in range(ATTEMPTS):
        try:
            disturbed = disturb(scene, noise, rng)
        except SceneError:  # bodies a millimetre apart that the noise pressed into each other
            continue
        try:
            return simulate(disturbed)
        except SimulationError:
            return None
    return None


def disturb(scene: Scene, noise: StartNoise, rng: np.random.Generator) -> Scene:
    """The scene with noise on every body's pose; joints keep their place in their parent, bodies of a rigid group to
    each other, and fixed bodies theirs.

    Raises SceneError if bodies then overlap.
    """
    spread = np.array([noise.position, noise.position, noise.yaw])
    old = scene.poses_world_from_body
    new = old + rng.normal(size=old.shape) * spread * ~scene.immovable[:, None]
    for group in scene.rigid_groups:
        first, *others = (scene.names.index(name) for name in group)
        new[others] = pose.compose(new[first], pose.relative(old[first], old[others]))
    return scene_at(scene, new)
