"""Setups: what they draw, that geometry does not leak joints, and that the same index gives the same bits."""

import itertools
import subprocess
import sys

import numpy as np
import pytest

from pushgraph.dataset.summary import penetration
from pushgraph.errors import SetupError
from pushgraph.scene import Scene
from pushgraph.shape import Cuboid, Cylinder
from pushgraph.simulation.articulation import draw_joints
from pushgraph.simulation.placement import NoRoom
from pushgraph.simulation.planar import simulate
from pushgraph.simulation.setups import (
    SETUPS,
    Plan,
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
    gaps = scene.contacts(pairs).gap.numpy()
    return {(scene.names[i], scene.names[j]): gap for (i, j), gap in zip(pairs, gaps, strict=True) if gap <= 0.0201}


def test_multiple_parts_has_the_paper_s_numbers(paper_plans: list[Plan]) -> None:
    assert 0.4 < np.mean([plan.density == "dense" for plan in paper_plans]) < 0.6
    for scene, _, style in paper_plans:
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
    for scene, density, _ in paper_plans:
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


def test_the_mixture_holds_the_variety_that_later_tasks_need() -> None:
    plans = draw_plans(varied, 50)
    scenes = [plan.scene for plan in plans]
    assert min(b.mass for s in scenes for b in s.bodies) < 0.25
    assert max(b.mass for s in scenes for b in s.bodies) > 8
    frictions = [s.table.friction for s in scenes]
    assert min(frictions) < 0.25
    assert max(frictions) > 0.55
    sides = [s.side_friction for s in scenes]
    assert 0.1 <= min(sides) < 0.15 < 0.35 < max(sides) <= 0.4
    speeds = [plan.style.speed for plan in plans]
    assert min(speeds) < 0.01
    assert max(speeds) > 0.2
    assert all((plan.style.distance == 0.05) == (plan.style.speed < 0.05) for plan in plans)
    round_tools = [s.tool.parts[0].shape.diameter for s in scenes if isinstance(s.tool.parts[0].shape, Cylinder)]
    assert min(round_tools) < 0.01
    assert any(len(s.tool.parts) > 1 for s in scenes)
    assert any(len(s.tool.parts) == 1 and isinstance(s.tool.parts[0].shape, Cuboid) for s in scenes)
    assert any(plan.style.rotation > 0.5 for plan in plans)
    assert any(plan.style.turned and not plan.style.rotation for plan in plans)
    assert any(s.rigid_groups for s in scenes)
    assert any(joint.anchor for s in scenes for joint in s.joints)
    assert any(joint.axis for s in scenes for joint in s.joints)


@pytest.mark.parametrize("setup", list(SETUPS))
def test_every_push_moves_something_and_nothing_sinks_in(setup: str) -> None:
    moved, frames, overlapping = 0, 0, 0
    for index in range(4):
        track = draw_trajectory(setup, 9, seed=7, index=index).track
        assert len(track.scene.pushes) == 9
        assert track.push_start.sum() == 9
        ends = [np.flatnonzero(track.push == push)[[0, -1]] for push in range(9)]
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
    for plan in draw_plans(varied, 10):
        bare = plan.scene.replace(joints=())
        for _ in range(3):
            joints = draw_joints(rng, bare)
            simulate(bare.replace(joints=joints))


def test_a_mixture_of_sizes_draws_all_of_them() -> None:
    sizes = {len(plan.scene.bodies) for plan in draw_plans(planar_mixed, 40)}
    assert sizes == {6, 7, 8, 9}
    assert {len(plan.scene.bodies) for plan in draw_plans(planar_mixed, 3, objects=4)} == {4}


def test_an_unknown_setup_is_refused_with_the_valid_ones() -> None:
    with pytest.raises(SetupError, match="no setup 'paper'; valid: multiple-parts, planar, planar-mixed"):
        draw_trajectory("paper", 9, 0, 0)


def test_every_other_trajectory_is_dense_and_half_the_mixture_is_the_paper_s() -> None:
    drawn = [draw_trajectory("planar", 2, seed=4, index=k) for k in range(8)]
    assert [trajectory.density for trajectory in drawn] == ["dense", "sparse"] * 4
    nominal = [t.track.scene.table.friction == 0.45 and t.track.scene.tool.reach == 0.05 for t in drawn]
    assert nominal == [True, True, False, False] * 2
