"""The simulated camera, the scenes of the paper's real robot, and beliefs that expect other joints."""

import math

import numpy as np
import pytest

from pushgraph.belief import TRAINING_PRIOR, BeliefModel
from pushgraph.body import Body, Joint
from pushgraph.errors import BeliefError
from pushgraph.graph.camera_noise import FINEST
from pushgraph.graph.scene_batch import JOINT_CODES
from pushgraph.pose import relative
from pushgraph.recording.recording import recording_of
from pushgraph.recording.sightings import NOTHING_DECLARED
from pushgraph.regulator import BeliefRegulator
from pushgraph.scene import Scene
from pushgraph.shape import Cuboid, Cylinder
from pushgraph.simulation.camera import Camera, film
from pushgraph.simulation.planar import simulate
from pushgraph.simulation.setups import draw_trajectory
from pushgraph.tool import Push, Tool
from pushgraph.track import Track

EXACT = Camera(rate=20.0, noise=0.0, yaw_noise=0.0, dropped=0.0)


def push_of_two(frames: int = 41) -> Track:
    """A tool that goes 0.4 m in 2 s along x past a box, whose yaw is seen, and a cylinder, whose yaw is not."""
    scene = Scene(
        bodies=(
            Body(name="box", shape=Cuboid(size=(0.1, 0.1)), pose_world_from_body=(0.0, 0.3, 0.2)),
            Body(name="disc", shape=Cylinder(diameter=0.1), pose_world_from_body=(0.3, 0.3, 0.0), yaw_known=False),
        ),
        tool=Tool.round(0.1),
    )
    poses = np.tile(np.vstack((np.zeros(3), scene.poses_world_from_body)), (frames, 1, 1))
    poses[:, 0, 0] = np.linspace(0.0, 0.4, frames)
    seen = np.ones((frames, 3), dtype=bool)
    return Track(scene, np.arange(frames) * 0.05, poses, np.zeros(frames, dtype=int), seen)


def test_an_exact_camera_at_the_rate_of_the_track_sees_the_track() -> None:
    track = push_of_two()
    seen = recording_of(film(track, np.random.default_rng(0), EXACT), track.scene, {}, NOTHING_DECLARED, 0.0, False)
    np.testing.assert_allclose(seen.track.times, track.times, atol=1e-12)
    np.testing.assert_allclose(seen.track.poses[:, :2], track.poses[:, :2], atol=1e-12)
    assert np.isnan(seen.track.poses[:, 2, 2]).all()
    assert (seen.track.push == 0).all()


def test_a_camera_has_its_rate_noise_origin_and_lost_frames() -> None:
    track = push_of_two(401)
    origin = (0.4, -0.2, math.pi / 2)
    camera = Camera(dropped=0.2, pose_world_from_origin=origin, probe_off=(0.002, 0.0))
    sightings = film(track, np.random.default_rng(1), camera)
    robot, box = (sightings.node == node for node in (0, 1))
    assert robot.sum() == 601  # 20 s at 30 Hz
    np.testing.assert_allclose(np.diff(sightings.time[robot]), 1 / 30)
    assert 0.7 < box.sum() / robot.sum() < 0.9
    x, y, yaw = relative(np.array(origin), track.poses[0, 1])
    for values, middle, spread in ((sightings.x, x, 1e-3), (sightings.y, y, 1e-3), (sightings.yaw, yaw, 0.0087)):
        assert values[box].mean() == pytest.approx(middle, abs=4 * spread / math.sqrt(box.sum()))
        assert values[box].std() == pytest.approx(spread, rel=0.15)
    np.testing.assert_allclose([sightings.x[0], sightings.y[0], sightings.yaw[0]], [0.202, 0.4, -math.pi / 2])


def test_the_tool_is_lifted_between_a_push_and_a_lift() -> None:
    track = push_of_two(4)
    lifted = Track(track.scene, track.times, track.poses, np.array([0, 0, -1, -1]), track.seen)
    sightings = film(lifted, np.random.default_rng(0), EXACT._replace(rate=40.0))
    assert sightings.push[sightings.node == 0].tolist() == [0, 0, 0, -1, -1, -1, -1]


def test_scenes_of_the_camera_are_those_of_the_protocol() -> None:
    tracks = [draw_trajectory("camera", 5, 1_000_000, index).track for index in range(8)]
    assert [len(track.scene.bodies) for track in tracks] == [2, 3, 4, 5] * 2
    motion = []
    for track in tracks:
        scene, (push,) = track.scene, track.scene.pushes
        assert 1 <= len(scene.joints) <= 3
        assert {joint.kind for joint in scene.joints} == {"fixed"}
        assert all(isinstance(body.shape, Cylinder) and not body.yaw_known for body in scene.bodies)
        assert 0.3 <= math.hypot(*push.displacement) <= 0.6
        assert len(scene.tool.parts) == 2
        motion.append(np.hypot(*(track.poses[-1] - track.poses[0])[1:, :2].T).mean())
    assert 0.12 < np.mean(motion) < 0.27


def glued_pair(joined: bool) -> Track:
    """Two discs side by side without yaw, one pushed by its outer half: glued they turn, else they part."""
    bodies = tuple(
        Body(name=name, shape=Cylinder(diameter=0.12), pose_world_from_body=(0.0, y, 0.0), mass=0.6, yaw_known=False)
        for name, y in (("a", 0.0), ("b", 0.125))
    )
    joints = (Joint(kind="fixed", parent="a", child="b"),) if joined else ()
    push = Push(start=(-0.13, -0.02), end=(0.2, -0.02), speed=0.2)
    return simulate(Scene(bodies=bodies, joints=joints, tool=Tool.round(0.1), pushes=(push,)))


@pytest.fixture(scope="module")
def belief() -> BeliefModel:
    return BeliefModel.load()


@pytest.mark.parametrize("joined", [True, False])
def test_without_yaw_glue_is_told_from_none_through_a_camera(joined: bool, belief: BeliefModel) -> None:
    track = glued_pair(joined)
    filmed = film(track, np.random.default_rng(2))
    seen = recording_of(filmed, track.scene, {}, NOTHING_DECLARED, None, False).believed()
    regulator = BeliefRegulator(track.scene, belief, prior={"none": 1.0, "fixed": 1.0})
    for poses, down in seen.frames():
        probabilities = regulator.observe(poses, down)
    assert (probabilities[0, JOINT_CODES["fixed"]] > 0.9) == joined
    assert probabilities[0, [JOINT_CODES["prismatic"], JOINT_CODES["revolute"]]].tolist() == [0, 0]


def test_a_prior_changes_odds_by_its_factor_and_leaves_the_rest(belief: BeliefModel) -> None:
    scene = glued_pair(True).scene.replace(pushes=())
    poses = np.vstack(([-0.13, 0.0, 0.0], scene.poses_world_from_body))
    usual = BeliefRegulator(scene, belief).observe(poses)[0]
    same = BeliefRegulator(scene, belief, prior=TRAINING_PRIOR).observe(poses)[0]
    other = BeliefRegulator(scene, belief, prior={"none": 0.54, "fixed": 0.28}).observe(poses)[0]
    assert same.tolist() == usual.tolist()
    assert other[1] / other[0] == pytest.approx(2 * usual[1] / usual[0], rel=1e-4)
    assert other[2:].tolist() == [0, 0]


@pytest.mark.parametrize(
    ("prior", "says"),
    [
        ({"none": 1.0, "glued": 1.0}, "no joint 'glued'; valid: none, fixed, prismatic, revolute"),
        ({"none": 1.0, "fixed": -1.0}, "fixed: must be a number from 0 on, got -1"),
        ({"none": 1.0}, "none and another joint must be possible; got none"),
        ({"fixed": 1.0, "revolute": 1.0}, "none and another joint must be possible; got fixed, revolute"),
    ],
)
def test_what_is_no_prior_is_refused(prior: dict[str, float], says: str, belief: BeliefModel) -> None:
    with pytest.raises(BeliefError, match=says):
        belief.expecting(prior)


def test_what_a_lens_bends_is_no_joint_where_that_is_expected(belief: BeliefModel) -> None:
    """A glued pair is pushed past a camera that does not jitter, whose lens pulls in by 6 mm what is 30 cm aside."""
    track = glued_pair(True)
    scene = track.scene.replace(bodies=tuple(body.replace(yaw_known=True) for body in track.scene.bodies))
    bodies = track.poses[:, 1:].copy()
    away = bodies[..., :2] - bodies[0, :, :2].mean(0)
    bodies[..., :2] -= 0.006 * away * (away**2).sum(-1, keepdims=True) / 0.3**3

    def fixed(camera_error: float | None) -> float:
        regulator = BeliefRegulator(scene, belief, camera_error=camera_error)
        for poses, seen, down in zip(track.poses, bodies, track.down, strict=True):
            regulator.observe(np.vstack((poses[:1], seen)), bool(down))
        return float(regulator.probabilities[0][JOINT_CODES["fixed"]])

    assert fixed(3e-4) > max(0.8, fixed(1e-4), fixed(None))
    assert fixed(FINEST) == fixed(None)
    assert belief.seen_by(3e-4).expecting(TRAINING_PRIOR).camera_error == 3e-4


@pytest.mark.parametrize("camera_error", [0.0, -1e-3, 0.02, math.nan])
def test_what_is_no_error_of_a_camera_is_refused(camera_error: float, belief: BeliefModel) -> None:
    with pytest.raises(BeliefError, match=f"camera_error: must be from 5e-05 to 0.005 m, got {camera_error:g}"):
        belief.seen_by(camera_error)


def test_bodies_that_a_fast_tool_carries_through_lost_frames_are_no_frame_that_moved() -> None:
    bodies = tuple(
        Body(name=name, shape=Cylinder(diameter=0.12), pose_world_from_body=(0.0, y, 0.0), yaw_known=False)
        for name, y in (("a", -0.07), ("b", 0.07))
    )
    scene = Scene(bodies=bodies, tool=Tool.round(0.1))
    times = np.arange(41) * 0.05
    poses = np.tile(np.vstack(([-0.09, 0.0, 0.0], scene.poses_world_from_body)), (41, 1, 1))
    poses[..., 0] += 0.28 * np.clip(times - 0.2, 0, 1.4)[:, None]
    track = Track(scene, times, poses, np.zeros(41, dtype=int), np.ones((41, 3), dtype=bool))
    filmed = film(track, np.random.default_rng(3), Camera(dropped=0.3))
    assert np.diff(filmed.time[filmed.node == 1]).max() > 0.09  # two frames in a row were lost
    recording = recording_of(filmed, scene, {}, NOTHING_DECLARED, 0.0, False)
    assert not [finding for finding in recording.findings if "leap as one" in str(finding)]
