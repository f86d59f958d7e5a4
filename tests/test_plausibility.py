"""What is assumed before a run, what refuses it, and what is remarked of its track."""

import numpy as np
import pytest
from scenes import body, workshop

import pushgraph as pg
from pushgraph.errors import PredictionError, SimulationError
from pushgraph.plausibility import assumptions, refusal, remarks, simplifications, start_fault
from pushgraph.scene import Scene, Table
from pushgraph.shape import Cuboid
from pushgraph.simulation.planar import simulate
from pushgraph.tool import Push, Tool
from pushgraph.track import FRAME, Track


def lane(*bodies, push: Push | None = None, **fields) -> Scene:
    """Bodies along x, and a thin tool that goes along it."""
    push = push or Push(start=(-0.2, 0), end=(0.2, 0))
    return Scene(bodies=bodies, tool=Tool.round(0.02), pushes=(push,), **fields)


def track(scene: Scene, tool_x, *bodies_x) -> Track:
    """A track in which everything is where it is told to be along x, frame by frame."""
    poses = np.zeros((len(tool_x), 1 + len(bodies_x), 3))
    poses[..., 0] = np.stack((tool_x, *bodies_x), -1)
    seen = np.ones(poses.shape[:2], bool)
    return Track(scene, np.arange(len(poses)) * FRAME, poses, np.zeros(len(poses), int), seen)


def cube(name: str, x: float, **fields):
    return body(name, x, 0.0, Cuboid(size=(0.1, 0.1))).replace(**fields)


def test_a_scene_that_says_everything_needs_no_assumption() -> None:
    assert assumptions(workshop()) == simplifications(workshop()) == []


def test_what_is_unknown_is_named_with_what_is_taken() -> None:
    scene = workshop().replace(
        bodies=tuple(b.replace(mass=None if b.name in ("lid", "cup") else b.mass) for b in workshop().bodies),
        table=Table(friction=None),
        side_friction=None,
        unknown_pairs=(("lid", "cup"),),
    )
    assert assumptions(scene) == [
        "mass of 'lid', 'cup' is unknown: taken as 0.6 kg, a nominal value",
        "table.friction is unknown: taken as 0.45, a nominal value",
        "side_friction is unknown: taken as 0.25, a nominal value",
        "'lid - cup' may be joined: taken as not joined",
    ]
    assert "no joint or rigid group lists" in assumptions(workshop().replace(unknown_pairs="unlisted"))[0]
    assert assumptions(workshop().replace(pushes=())) == ["the scene has no pushes: nothing moves"]


def test_long_lists_are_cut_and_fixed_bodies_need_no_mass() -> None:
    many = tuple(body(f"b{k}", 0.2 * (k % 5), 0.2 * (k // 5), mass=None) for k in range(20))
    (said,) = assumptions(Scene(bodies=many, pushes=(Push(start=(-0.5, 0), end=(-0.5, 0.1)),)))
    assert "'b7', 12 more is unknown" in said
    fixed = tuple(b.replace(fixed=True) for b in many)
    assert assumptions(Scene(bodies=fixed, pushes=(Push(start=(-0.5, 0), end=(-0.5, 0.1)),))) == []


def test_what_the_networks_do_not_know_is_said() -> None:
    push = Push(start=(-0.2, 0), end=(0.2, 0), force_limit=3.0)
    scene = lane(cube("a", 0), cube("wall", 0.3, fixed=True), push=push)
    assert simplifications(scene) == []
    held, unlimited = simplifications(scene, solved=False)
    assert held.startswith("'wall' cannot move: predicted as bodies of great mass")
    assert unlimited.startswith("force_limit of pushes[0] is ignored")


def test_a_good_track_has_no_remarks() -> None:
    assert remarks(simulate(workshop())) == []
    assert remarks(simulate(workshop().replace(pushes=()))) == []


def test_what_leaves_the_table_is_named_with_its_time() -> None:
    scene = lane(cube("a", 0), table=Table(size=(0.6, 0.6)))
    x = np.array([0, 0.1, 0.25, 0.31, 0.31, 0.2, 0.5])
    assert remarks(track(scene, x - 0.06, x)) == [
        "'a' leaves the table at 0.15 s: from then on its pose means nothing"
    ]
    beyond = lane(cube("a", 0), cube("wall", 0.5, fixed=True), table=Table(size=(0.6, 0.6)))
    still = np.zeros(3)
    assert remarks(track(beyond, still - 0.06, still, still + 0.5)) == []


def test_what_has_not_come_to_rest_is_named_with_its_speed() -> None:
    scene = lane(cube("a", 0), cube("b", 0.3))
    x = np.array([0, 0.01, 0.018])
    (said,) = remarks(track(scene, x * 0 - 0.1, x, x * 0 + 0.3))
    assert said.startswith("'a' still moves when the track ends, at 160 mm/s and 0 degrees/s: give the last push")
    assert remarks(track(scene, x * 0 - 0.1, np.minimum(x, 0.01) + [0, 0, 4e-5], x * 0 + 0.3)) == []
    spinning = track(scene, x * 0 - 0.1, x * 0, x * 0 + 0.3)
    spinning.poses[-1, 2, 2] = 0.01
    assert remarks(spinning)[0].startswith("'b' still moves when the track ends, at 0 mm/s and 11 degrees/s")


def test_what_is_crushed_or_overlaps_is_named_with_the_worst_depth() -> None:
    scene = lane(cube("a", 0), cube("wall", 0.15, fixed=True), cube("post", -0.4, fixed=True))
    still = np.zeros(4)

    def said(tool, a) -> list[str]:
        return remarks(track(scene, still + tool, still + a, still + 0.15, still - 0.4))

    deeper = np.array([0.05, 0.062, 0.055, 0.055])
    assert said(deeper - 0.055, deeper) == [
        "'a' is crushed between the tool and 'wall', 17.0 mm deep at 0.05 s: a pusher with a force_limit would stall"
    ]
    assert said(-0.3, deeper) == ["'wall' overlaps 'a', 12.0 mm deep at 0.05 s"]
    assert said(-0.055, 0) == ["the tool overlaps 'a', 5.0 mm deep at 0.00 s"]
    assert said(-0.345, 0) == ["the tool overlaps fixed 'post', 5.0 mm deep at 0.00 s"]
    shallow = np.array([0, 0.0515, 0.0515, 0.0515])
    assert said(-0.0585, shallow) == []  # 1.5 mm in the tool, then in the wall
    assert "crushed between the tool and 'wall', 3.0 mm deep" in said(shallow - 0.0585, shallow)[0]


def test_a_lifted_tool_and_lost_bodies_overlap_nothing() -> None:
    scene, still = lane(cube("a", 0).replace(yaw_known=False)), np.zeros(3)
    lifted = track(scene, still, still)
    lifted.push[:] = -1
    assert remarks(lifted) == []
    lost = track(scene, still, still)
    lost.poses[:, 1], lost.seen[:, 1] = np.nan, False
    assert remarks(lost) == []


def test_a_tool_that_stalls_is_said_with_how_much_is_missing() -> None:
    scene = lane(cube("a", 0.5), push=Push(start=(-0.2, 0), end=(0.2, 0), force_limit=2.5))
    x = np.array([-0.2, 0.0, 0.0])
    (said,) = remarks(track(scene, x, x * 0 + 0.5))
    assert said == (
        "pushes[0]: the tool ends 200.0 mm from where it was to go: it stalls at its force_limit of 2.5 N"
    )
    assert remarks(track(scene, x + [0, 0.2, 0.2], x * 0 + 0.5)) == []


def twice(second_start: float) -> Scene:
    """The second push starts where the first has brought the body, or clear of it."""
    first, second = Push(start=(-0.2, 0), end=(0.1, 0)), Push(start=(second_start, 0), end=(second_start, 0.1))
    return Scene(bodies=(cube("a", 0),), pushes=(first, second))


def test_both_refuse_a_push_that_comes_down_on_a_body_in_the_same_words() -> None:
    says = r"pushes\[1\].start: the tool would come down on body 'a', \d+.\d mm deep, where it lies by then"
    with pytest.raises(SimulationError, match=says):
        simulate(twice(0.25))
    with pytest.raises(PredictionError, match=says):
        pg.load().predict(twice(0.25))
    (many,) = pg.load().predict_many([twice(0.25)])
    assert "come down on body 'a'" in refusal(many)
    assert refusal(pg.load().predict(twice(-0.3))) is None


def test_a_prediction_may_be_off_by_a_little_where_the_tool_comes_down() -> None:
    scene, tool = lane(cube("a", 0)), np.array([-0.057, 0, 0])
    assert "3.0 mm deep" in start_fault(scene, 0, tool, scene.poses_world_from_body)
    assert start_fault(scene, 0, tool, scene.poses_world_from_body, deepest=5e-3) is None


def test_predictions_hold_fixed_bodies_and_say_that_the_tool_crushes_what_is_between() -> None:
    bodies = (cube("a", 0), cube("wall", 0.2, fixed=True), body("arm", 0.2, 0.06, Cuboid(size=(0.1, 0.04))))
    scene = Scene(
        bodies=bodies, rigid_groups=(("wall", "arm"),), pushes=(Push(start=(-0.15, 0), end=(0.1, 0), speed=0.1),)
    )
    predicted = pg.load().predict(scene)
    assert (predicted.poses[:, 2:] == scene.poses_world_from_body[1:]).all()
    assert "'a' is crushed between the tool and 'wall'" in remarks(predicted)[0]


def test_the_public_names_are_the_functions() -> None:
    assert pg.remarks is remarks
    assert pg.assumptions is assumptions


def test_a_watched_scene_joins_no_two_fixed_bodies() -> None:
    bodies = (cube("a", 0), cube("wall", 0.3, fixed=True), cube("post", 0.39, fixed=True))
    scene = lane(*bodies, push=Push(start=(-0.2, 0), end=(-0.1, 0)))
    regulator = pg.BeliefRegulator(scene)
    for poses in pg.load().predict(scene).poses[:3]:
        regulator.observe(poses)
    believed = regulator.scene()
    assert not any({joint.parent, joint.child} == {"wall", "post"} for joint in believed.joints)
    np.testing.assert_allclose(believed.poses_world_from_body, scene.poses_world_from_body, atol=1e-9)


def test_a_picture_is_drawn_of_a_push_along_a_path(tmp_path) -> None:
    push = Push(start=(-0.2, 0), path=[(0, 0.1), (0.1, 0.1, 0.3)], times=(1, 1.2))
    scene = Scene(bodies=(cube("a", 0.3),), pushes=(push, push.replace(times=None, path=[(-0.2, 0)])))
    pg.save_picture(simulate(scene), tmp_path / "picture.png")
    assert (tmp_path / "picture.png").stat().st_size > 10_000
