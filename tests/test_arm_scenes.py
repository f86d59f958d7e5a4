"""The arm against the kinematic pusher in ten scenes of the paper's setup: it does the same, within the noise floor."""

import math

import numpy as np
import pytest

from pushgraph.arm import Arm
from pushgraph.evaluation.noise_floor import CAMERA, simulate_again
from pushgraph.scene import Scene
from pushgraph.simulation.arm import simulate_with_arm
from pushgraph.simulation.motion import ToolMotion
from pushgraph.simulation.setups import FIRST_TEST_SEED, draw_trajectory
from pushgraph.track import Track

PUSHES = 3
MOVED = 0.01


def within_reach(scene: Scene) -> Scene:
    """The scene with the arm where it reaches all pushes, as some place does in each of these."""
    ways = [ToolMotion(push, scene.tool).poses(np.linspace(0, 20, 100)) for push in scene.pushes]
    places = [(x, y, math.atan2(-y, -x)) for x in np.arange(-0.9, 0.91, 0.15) for y in np.arange(-0.9, 0.91, 0.15)]
    arms = [Arm(pose_world_from_base=tuple(map(float, place))) for place in places]
    best = max(arms, key=lambda arm: sum(bool(arm.reaches(way).all()) for way in ways))
    assert all(best.reaches(way).all() for way in ways)
    return scene.replace(arm=best)


def after_pushes(track: Track) -> np.ndarray:
    return track.poses[np.flatnonzero(track.push == PUSHES - 1)[-1], 1:, :2]


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_ten_scenes_end_as_with_the_kinematic_pusher_within_the_noise_floor() -> None:
    rng = np.random.default_rng(0)
    by_arm, by_noise = [], []
    for index in range(10):
        whole = draw_trajectory("multiple-parts", 9, FIRST_TEST_SEED, index).track
        scene = within_reach(whole.scene)
        scene = scene.replace(pushes=scene.pushes[:PUSHES])
        track = simulate_with_arm(scene).track
        exact = after_pushes(whole)
        moved = np.hypot(*(exact - whole.poses[0, 1:, :2]).T) > MOVED
        by_arm.extend(np.hypot(*(after_pushes(track) - exact)[moved].T))
        frames = int(np.flatnonzero(whole.push == PUSHES - 1)[-1])
        for _ in range(3):
            noisy = simulate_again(whole, frames, CAMERA, rng)
            assert noisy is not None, f"scene {index}: the noise led a body beneath the tool"
            by_noise.extend(np.hypot(*(after_pushes(noisy) - exact)[moved].T))
    assert np.mean(by_arm) < np.mean(by_noise)
    assert np.median(by_arm) < 1e-3
