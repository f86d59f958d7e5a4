"""A scene goes the same way wherever it lies and however it is turned."""

import numpy as np
import pytest

from pushgraph import Push, Scene, pose
from pushgraph.simulation.own_frame import OwnFrame
from pushgraph.simulation.planar import simulate
from pushgraph.simulation.setups import draw_trajectory

MOTIONS = [(0.37, -0.6, 0.0), (0.0, 0.0, 1.0), (-0.8, 0.3, -2.7), (1e-9, 0.0, 1e-9)]


@pytest.fixture(scope="module")
def crowded() -> Scene:
    """Nine bodies in contact: chaotic, so that rounding alone would show after a push."""
    scene = draw_trajectory("multiple-parts", 9, seed=1_000_000, index=2).track.scene
    return scene.replace(pushes=scene.pushes[:2])


@pytest.mark.parametrize("motion", MOTIONS)
def test_place_and_turn_of_a_scene_change_nothing_but_rounding(crowded, motion):
    motion = np.array(motion)
    here, there = simulate(crowded), simulate(crowded.moved(motion))
    back = pose.compose(pose.inverse(motion), there.poses)
    assert np.abs(here.poses[-1, 1:, :2] - here.poses[0, 1:, :2]).max() > 0.05
    np.testing.assert_allclose(back, here.poses, atol=1e-8)
    force = pose.rotate(there.wrench[:, :2], -motion[2])
    np.testing.assert_allclose(np.column_stack((force, there.wrench[:, 2])), here.wrench, atol=1e-4)


def test_poses_and_wrenches_come_back_to_the_world(crowded):
    frame = OwnFrame(crowded)
    seen = frame.scene(crowded)
    np.testing.assert_allclose(
        frame.poses_in_world(seen.poses_world_from_body), crowded.poses_world_from_body, atol=1e-9
    )
    first = seen.names.index(min(seen.names))
    np.testing.assert_array_equal(seen.poses_world_from_body[first], 0.0)
    push = Push(start=(0.1, 0.2), path=((0.3, 0.2), (0.3, 0.4, 1.0)))
    np.testing.assert_allclose(frame.poses_in_world(frame.push(push).waypoints), push.waypoints, atol=1e-9)
