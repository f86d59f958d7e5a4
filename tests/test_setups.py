"""Setups: what they draw, that geometry does not leak joints, and that the same index gives the same bits."""

import itertools
import subprocess
import sys

import numpy as np
import pytest

from pushgraph import pose
from pushgraph.dataset.summary import penetration
from pushgraph.errors import SetupError
from pushgraph.graph.scene_batch import batch_scenes
from pushgraph.scene import Scene, Table
from pushgraph.shape import Cuboid, Cylinder
from pushgraph.simulation import linkages
from pushgraph.simulation.aiming import PushStyle, aim
from pushgraph.simulation.articulation import draw_joints
from pushgraph.simulation.assembly import assemble
from pushgraph.simulation.block import Block, arrange
from pushgraph.simulation.kinds import KINDS, MOST_BODIES
from pushgraph.simulation.placement import NoRoom
from pushgraph.simulation.plan import Plan
from pushgraph.simulation.planar import PlanarSimulation, simulate
from pushgraph.simulation.pushers import draw_blade, draw_probe
from pushgraph.simulation.setups import (
    OBJECTS,
    SETUPS,
    _TooFewNeighbours,
    draw_trajectory,
    multiple_parts,
    planar_mixed,
    varied,
)


def draw_plans(setup, count: int, objects: int = 9) -> list[Plan]:
    plans = []
    for seed in itertools.count():
        if len(plans) == count:
            return plans
        try:
            plans.append(setup(np.random.default_rng(seed), objects, seed))
        except (NoRoom, _TooFewNeighbours):
            continue
    raise AssertionError


@pytest.fixture(scope="module")
def paper_plans() -> list[Plan]:
    return draw_plans(multiple_parts, 50)


def neighbour_gaps(scene: Scene) -> dict[tuple[str, str], float]:
    pairs = list(itertools.combinations(range(len(scene.bodies)), 2))
    gaps = scene.contacts(pairs).gap
    return {(scene.names[i], scene.names[j]): gap for (i, j), gap in zip(pairs, gaps, strict=True) if gap <= 0.0201}


def test_multiple_parts_has_the_paper_s_numbers(paper_plans: list[Plan]) -> None:
    assert 0.4 < np.mean([plan.density == "dense" for plan in paper_plans]) < 0.6
    for scene, _, style, kind in paper_plans:
        assert kind == "paper"
        assert len(scene.bodies) == 9
        assert 2 <= len(scene.joints) <= 6
        assert 0.10 <= style.speed <= 0.30
        assert style.distance == 0.30
        assert scene.tool.parts[0].shape.diameter == 0.10
        assert (scene.table.friction, scene.side_friction) == (0.45, 0.25)
        for body in scene.bodies:
            lengths = body.shape.size if isinstance(body.shape, Cuboid) else (body.shape.diameter,)
            assert all(0.08 <= length <= 0.16 for length in lengths)
            assert 0.2 <= body.mass <= 1.0
    kinds = [joint.kind for plan in paper_plans for joint in plan.scene.joints]
    for kind in ("fixed", "revolute", "prismatic"):
        assert kinds.count(kind) / len(kinds) == pytest.approx(1 / 3, abs=0.1)
    shapes = [isinstance(body.shape, Cylinder) for plan in paper_plans for body in plan.scene.bodies]
    assert np.mean(shapes) == pytest.approx(0.5, abs=0.1)


def test_neighbours_stand_1_to_20_mm_apart_in_dense_and_sparse_scenes(paper_plans: list[Plan]) -> None:
    for scene, density, _, _ in paper_plans:
        gaps = neighbour_gaps(scene)
        assert min(gaps.values()) >= 0.001 - 1e-6
        if density == "dense":
            connected = {name for pair in gaps for name in pair}
            assert connected == set(scene.names)


def test_gaps_tell_nothing_about_joints(paper_plans: list[Plan]) -> None:
    from scipy.stats import ks_2samp

    for density in ("dense", "sparse"):
        joined, unjoined = [], []
        for plan in paper_plans:
            pairs = {frozenset((joint.parent, joint.child)) for joint in plan.scene.joints}
            for pair, gap in neighbour_gaps(plan.scene).items() if plan.density == density else ():
                (joined if frozenset(pair) in pairs else unjoined).append(gap)
        assert min(len(joined), len(unjoined)) > 40
        assert ks_2samp(joined, unjoined).pvalue > 1e-3


@pytest.fixture(scope="module")
def plans_of_kinds() -> dict[str, list[Plan]]:
    """Eight plans of every kind."""
    plans = {kind: [] for kind in KINDS}
    for plan in draw_plans(varied, 8 * len(KINDS), objects=4):
        plans[plan.kind].append(plan)
    return plans


@pytest.fixture(scope="module")
def varied_plans(plans_of_kinds: dict[str, list[Plan]]) -> list[Plan]:
    return [plan for plans in plans_of_kinds.values() for plan in plans]


def narrowest(shape: Cuboid | Cylinder) -> float:
    return min(shape.size) if isinstance(shape, Cuboid) else shape.diameter


def widest(shape: Cuboid | Cylinder) -> float:
    return max(shape.size) if isinstance(shape, Cuboid) else shape.diameter


def covers(values, low: float, high: float) -> bool:
    """Whether the values reach both ends, each to be named with some slack."""
    return min(values) <= low and max(values) >= high


def test_the_kinds_are_evenly_spread_and_dense_as_often_as_sparse(plans_of_kinds: dict[str, list[Plan]]) -> None:
    assert [len(plans) for plans in plans_of_kinds.values()] == pytest.approx([8] * len(KINDS), abs=4)
    for plans in plans_of_kinds.values():
        assert {plan.density for plan in plans} == {"dense", "sparse"}


def test_the_mixture_covers_what_a_scene_may_say(varied_plans: list[Plan]) -> None:
    scenes = [plan.scene for plan in varied_plans]
    bodies = [body for scene in scenes for body in scene.bodies if not body.fixed]
    assert covers([scene.table.friction for scene in scenes], 0.06, 1.3)
    assert all(0.05 <= scene.table.friction <= 1.5 for scene in scenes)
    assert covers([scene.side_friction for scene in scenes], 0.05, 0.95)
    assert all(body.mass >= 0.001 for body in bodies)
    assert covers([body.mass for body in bodies], 0.01, 20.0)
    assert covers([widest(body.shape) for body in bodies], 0.015, 0.45)
    assert covers([narrowest(body.shape) for body in bodies], 0.0045, 0.25)
    assert max(widest(body.shape) / narrowest(body.shape) for body in bodies) > 9
    assert covers([plan.style.speed for plan in varied_plans], 0.004, 0.8)
    parts = [part.shape for scene in scenes for part in scene.tool.parts]
    assert covers([widest(shape) for shape in parts], 0.005, 0.25)
    assert min(narrowest(shape) for shape in parts) < 0.004
    assert {len(scene.tool.parts) for scene in scenes} >= {1, 2, 3, 4}
    assert any(plan.style.rotation > 0.5 for plan in varied_plans)
    assert any(scene.immovable.any() for scene in scenes)
    assert any(assemble(scene).loops for scene in scenes)
    pieces = [len(group) for scene in scenes for group in scene.rigid_groups]
    assert covers(pieces, 2, 25)
    assert max(len(scene.bodies) for scene in scenes) <= MOST_BODIES


def test_tools_are_probes_and_blades() -> None:
    rng = np.random.default_rng(0)
    assert covers([draw_probe(rng).reach for _ in range(50)], 0.0017, 0.0045)
    assert covers([draw_blade(rng).parts[0].shape.size[1] for _ in range(50)], 0.06, 0.5)


def test_joints_sit_anywhere_but_can_move() -> None:
    spans = {"revolute": [], "prismatic": []}
    off_the_line = []
    for seed in range(8):
        scene = KINDS["joints"](np.random.default_rng(seed), 7, "dense").scene
        for joint in scene.joints:
            if joint.limits:
                spans[joint.kind].append(joint.limits[1] - joint.limits[0])
            if joint.axis:
                ends = [scene.names.index(name) for name in (joint.parent, joint.child)]
                x, y = np.subtract(*scene.poses_world_from_body[ends, :2])
                off_the_line.append(abs(x * joint.axis[1] - y * joint.axis[0]) / np.hypot(x, y))
    assert covers(spans["revolute"], 0.4, 1.5)
    assert min(spans["revolute"]) >= 0.05
    assert covers(spans["prismatic"], 0.015, 0.04)
    assert max(off_the_line) > 0.8


def test_training_reads_every_kind(varied_plans: list[Plan]) -> None:
    scenes = [plan.scene for plan in varied_plans]
    assert {body.shape.kind for scene in scenes for body in scene.bodies} == {"cuboid", "cylinder"}
    batch = batch_scenes(scenes)
    assert batch.immovable.any()
    assert batch.present.shape[1] <= MOST_BODIES


def test_gaps_of_the_mixture_tell_nothing_about_joints() -> None:
    from scipy.stats import ks_2samp

    joined, unjoined = [], []
    for seed in range(30):
        scene = KINDS["frictions"](np.random.default_rng(seed), 6, "dense").scene
        pairs = {frozenset((joint.parent, joint.child)) for joint in scene.joints}
        for pair, gap in neighbour_gaps(scene).items():
            (joined if frozenset(pair) in pairs else unjoined).append(gap)
    assert min(len(joined), len(unjoined)) > 60
    assert ks_2samp(joined, unjoined).pvalue > 1e-3


def test_linkages_stand_as_they_do_without_their_joints() -> None:
    counts = [len(linkages.draw_ring(np.random.default_rng(seed), 0.3, 4).joints) for seed in range(60)]
    assert 0.5 < np.mean(np.array(counts) == 4) < 0.9
    assert min(counts) < 3


def test_rows_touch(plans_of_kinds: dict[str, list[Plan]]) -> None:
    longest = 0
    for plan in plans_of_kinds["rows"]:
        gaps = plan.scene.contacts([(k, k + 1) for k in range(len(plan.scene.bodies) - 1)]).gap
        row = 1 + int(np.argmax(np.abs([*gaps, 1.0]) > 1e-6))
        assert row >= 3
        longest = max(longest, row)
    assert longest > 12


def alone(block: Block) -> Scene:
    return arrange([block], np.array([[0.1, -0.2, 0.7]]), [[0.5] * len(block.parts)], table=Table(size=(4.0, 4.0)))


@pytest.mark.parametrize(
    "draw",
    [
        lambda rng: linkages.draw_ring(rng, 0.4, 4),
        lambda rng: linkages.draw_ring(rng, 0.4, 7),
        lambda rng: linkages.draw_slider_crank(rng, 0.4),
    ],
)
def test_loops_close_and_move(draw, monkeypatch) -> None:
    monkeypatch.setattr(linkages, "OPEN", 0.0)
    moved = []
    for seed in range(3):
        rng = np.random.default_rng(seed)
        scene = alone(draw(rng))
        assert len(assemble(scene).loops) == 1
        simulation = PlanarSimulation(scene)
        touched = np.zeros(len(scene.bodies), dtype=int)
        for _ in range(3):
            simulation.push(aim(rng, scene, simulation.poses, touched, PushStyle(0.15, 0.2)))
        track = simulation.track()
        turned = track.poses[:, 1:, 2] - track.poses[0, 1:, 2]
        for joint in scene.joints:
            a, b = (scene.names.index(name) for name in (joint.parent, joint.child))
            moved.append(np.abs(turned[:, b] - turned[:, a]).max())
            if joint.kind == "revolute":
                anchor = scene.joint_frame(joint).anchor
                ends = [
                    pose.transform(track.poses[:, 1 + k], pose.transform(pose.inverse(track.poses[0, 1 + k]), anchor))
                    for k in (a, b)
                ]
                assert np.abs(ends[0] - ends[1]).max() < 5e-4
        assert penetration(track).max() < 2e-3
    assert np.median(moved) > 0.1


@pytest.mark.parametrize("draw", [linkages.draw_door, linkages.draw_drawer])
def test_doors_and_drawers_open_and_their_frames_stay(draw, monkeypatch) -> None:
    monkeypatch.setattr(linkages, "OPEN", 0.0)
    scene = alone(draw(np.random.default_rng(1), 0.2))
    assert scene.immovable.any()
    assert len(scene.joints) == 1
    lower, upper = scene.joints[0].limits
    assert lower <= 0 < upper


@pytest.mark.parametrize("kind", list(KINDS))
def test_every_kind_makes_a_trajectory(kind: str, monkeypatch) -> None:
    monkeypatch.setitem(SETUPS, "varied", varied)
    index = 4 * list(KINDS).index(kind)
    trajectory = draw_trajectory("varied", 3, seed=2, index=index)
    track = trajectory.track
    assert trajectory.kind == kind
    assert trajectory.density == "dense"
    assert np.isfinite(track.poses).all()
    assert len(track.times) <= 1200
    assert (penetration(track) <= 1e-3).mean() > 0.97
    assert not np.abs(track.poses[:, 1:][:, track.scene.immovable] - track.poses[0, 1:][track.scene.immovable]).any()


@pytest.mark.parametrize("setup", list(SETUPS))
def test_every_push_moves_something_and_nothing_sinks_in(setup: str) -> None:
    moved, frames, overlapping = 0, 0, 0
    for index in range(4):
        track = draw_trajectory(setup, 3 if setup in OBJECTS else 9, seed=7, index=index).track
        pushes = len(track.scene.pushes)
        others = {"different-masses": 3, "different-masses-mixed": 3, "controlled-masses": 1, "camera": 1}
        assert pushes == others.get(setup, 9)
        assert track.push_start.sum() == pushes
        ends = [np.flatnonzero(track.push == push)[[0, -1]] for push in range(pushes)]
        moved += all(np.hypot(*(track.poses[b] - track.poses[a])[1:, :2].T).max() > 0.005 for a, b in ends)
        overlap = penetration(track)
        frames, overlapping = frames + len(overlap), overlapping + (overlap > 1e-3).sum()
        assert np.isfinite(track.poses).all()
    assert moved >= 3
    assert overlapping / frames <= 1e-3


@pytest.mark.parametrize("objects", [1, 2, 12])
def test_any_number_of_objects(objects: int) -> None:
    track = draw_trajectory("multiple-parts", objects, seed=0, index=0).track
    assert len(track.scene.bodies) == objects
    assert len(track.scene.joints) <= max(0, objects - 1)


def test_the_same_index_gives_the_same_bits_in_any_process() -> None:
    code = (
        "import hashlib; from pushgraph.simulation.setups import draw_trajectory;"
        "print(hashlib.sha256(draw_trajectory('planar', 4, 3, 5).track.poses.tobytes()).hexdigest())"
    )
    runs = {subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout for _ in range(2)}
    import hashlib

    here = hashlib.sha256(draw_trajectory("planar", 4, 3, 5).track.poses.tobytes()).hexdigest()
    assert runs == {here + "\n"}
    other = draw_trajectory("planar", 4, 3, 6).track
    assert hashlib.sha256(other.poses.tobytes()).hexdigest() != here


def test_a_drawn_track_is_what_its_scene_simulates_to() -> None:
    track = draw_trajectory("planar", 5, seed=1, index=2).track
    again = simulate(Scene.from_json(track.scene.to_json()))
    assert again.poses.tobytes() == track.poses.tobytes()


def test_joints_never_close_a_cycle_with_rigid_groups() -> None:
    rng = np.random.default_rng(0)
    for plan in draw_plans(varied, 6, objects=6):
        bare = plan.scene.replace(joints=())
        for _ in range(3):
            joints = draw_joints(rng, bare)
            simulate(bare.replace(joints=joints))


def test_a_mixture_of_sizes_draws_all_of_them() -> None:
    def paper(rng: np.random.Generator, objects: int, index: int) -> Plan:
        return planar_mixed(rng, objects, 4 * index)

    assert {len(plan.scene.bodies) for plan in draw_plans(paper, 20)} == {6, 7, 8, 9}
    assert {len(plan.scene.bodies) for plan in draw_plans(paper, 3, objects=4)} == {4}


def test_an_unknown_setup_is_refused_with_the_valid_ones() -> None:
    with pytest.raises(SetupError, match="no setup 'paper'; valid: multiple-parts, jointed, planar, planar-mixed"):
        draw_trajectory("paper", 9, 0, 0)


def test_every_other_trajectory_is_dense_and_half_the_mixture_is_the_paper_s() -> None:
    drawn = [draw_trajectory("planar", 2, seed=4, index=k) for k in range(8)]
    assert [trajectory.density for trajectory in drawn] == ["dense", "sparse"] * 4
    nominal = [t.track.scene.table.friction == 0.45 and t.track.scene.tool.reach == 0.05 for t in drawn]
    assert nominal == [True, True, False, False] * 2
    assert [trajectory.kind for trajectory in drawn] == [
        *["paper"] * 2,
        *["frictions"] * 2,
        *["paper"] * 2,
        *["sizes"] * 2,
    ]
