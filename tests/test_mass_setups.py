"""Setups of masses: what they draw, that pushes scatter, and that nothing but masses differs in controlled scenes."""

import itertools
from collections import Counter

import numpy as np
import pytest

from pushgraph.dataset.generate import generate
from pushgraph.dataset.summary import penetration
from pushgraph.errors import SetupError
from pushgraph.mass_prior import HEAVY, LIGHT, MASS_CLASSES, NORMAL, class_of
from pushgraph.scene import Scene
from pushgraph.shape import Cylinder
from pushgraph.simulation.aiming import PushStyle, aim
from pushgraph.simulation.masses import controlled_scene, different_masses, weighing
from pushgraph.simulation.planar import PlanarSimulation, simulate
from pushgraph.simulation.setups import draw_trajectory
from pushgraph.track import Track

EXTREMES = (LIGHT.lowest, (NORMAL.lowest + NORMAL.highest) / 2, HEAVY.highest)
TOUCH = 0.5e-3
"""Bodies this near to each other (m) touch."""


def in_classes(scene: Scene) -> list[str]:
    """Names of the classes of the bodies' masses, which must lie in them."""
    classes = [MASS_CLASSES[class_of(MASS_CLASSES, body.mass)] for body in scene.bodies]
    for one, body in zip(classes, scene.bodies, strict=True):
        assert one.lowest <= body.mass <= one.highest
    return [one.name for one in classes]


def motion(track: Track) -> np.ndarray:
    """How far each body has moved (m)."""
    return np.hypot(*(track.poses[-1] - track.poses[0])[1:, :2].T)


def test_different_masses_are_cylinders_of_three_classes_equally_often_pushed_three_times() -> None:
    plans = [different_masses(np.random.default_rng(seed), 9, seed) for seed in range(40)]
    assert [plan.density for plan in plans] == ["dense", "sparse"] * 20
    counts = Counter(name for plan in plans for name in in_classes(plan.scene))
    for name in ("light", "normal", "heavy"):
        assert counts[name] / counts.total() == pytest.approx(1 / 3, abs=0.08)
    for scene, _, style, _ in plans:
        assert not scene.joints
        assert all(isinstance(body.shape, Cylinder) and 0.08 <= body.shape.diameter <= 0.16 for body in scene.bodies)
        assert (style.pushes, style.distance, style.scatters) == (3, 0.30, True)
        assert 0.10 <= style.speed <= 0.30
    assert {body.mass for body in plans[0].scene.bodies}.isdisjoint(body.mass for body in plans[1].scene.bodies)


def test_three_pushes_move_most_of_nine_bodies_and_nothing_sinks_in() -> None:
    tracks = [draw_trajectory("different-masses", 9, seed=3, index=index).track for index in range(8)]
    assert np.mean([motion(track) > 0.005 for track in tracks]) > 0.8
    assert np.mean([motion(track).mean() for track in tracks]) > 0.08
    assert np.concatenate([penetration(track) <= 1e-3 for track in tracks]).mean() > 0.999


@pytest.mark.parametrize("objects", [1, 2, 6, 12])
def test_different_masses_has_any_number_of_objects(objects: int) -> None:
    assert len(draw_trajectory("different-masses", objects, seed=0, index=1).track.scene.bodies) == objects


def test_pushes_that_scatter_go_where_bodies_are_pushed_into_others() -> None:
    """A row of four among eight bodies that stand alone, and pushes too short to meet two of a row themselves."""
    row = [(0.105 * k, 0.0) for k in range(4)]
    alone = [(x, y) for x in (-0.6, -0.2, 0.2, 0.6) for y in (-0.4, 0.4)]
    body = controlled_scene(2).bodies[0].replace(shape=Cylinder(diameter=0.10))
    scene = Scene(
        bodies=tuple(
            body.replace(name=f"body{k}", pose_world_from_body=(x, y, 0.0)) for k, (x, y) in enumerate(row + alone)
        )
    )
    moved = {}
    for scatters in (False, True):
        counts = []
        for seed in range(8):
            simulation = PlanarSimulation(scene)
            untouched = np.zeros(len(scene.bodies), dtype=np.int64)
            style = PushStyle(0.08, 0.2, scatters=scatters)
            simulation.push(aim(np.random.default_rng(seed), scene, simulation.poses, untouched, style))
            counts.append((motion(simulation.track()) > 0.005).sum())
        moved[scatters] = np.mean(counts)
    assert moved[True] > moved[False] + 0.7


@pytest.mark.parametrize("objects", [2, 3])
def test_only_masses_differ_in_controlled_scenes(objects: int) -> None:
    nominal = simulate(controlled_scene(objects))
    scenes, classes = [], set()
    for index in range(10):
        track = draw_trajectory("controlled-masses", objects, seed=5, index=index).track
        assert len(track.times) == 74
        np.testing.assert_array_equal(track.poses[:, 0], nominal.poses[:, 0])
        classes |= set(in_classes(track.scene))
        scenes.append(track.scene)
    assert classes == {"light", "normal", "heavy"}
    assert {weighing(scene, [1.0] * objects) for scene in scenes} == {
        weighing(controlled_scene(objects), [1.0] * objects)
    }
    assert len({body.mass for scene in scenes for body in scene.bodies}) == 10 * objects


@pytest.mark.parametrize("objects", [2, 3])
def test_every_object_is_touched_and_moves_by_3_cm_whatever_the_masses(objects: int) -> None:
    scene = controlled_scene(objects)
    pairs = list(itertools.combinations(range(objects), 2))
    for masses in itertools.product(EXTREMES, repeat=objects):
        track = simulate(weighing(scene, masses))
        assert len(track.times) == 74
        assert motion(track).min() >= 0.03, masses
        assert penetration(track).max() < 1e-3
        touching = scene.pair_gaps(pairs, track.poses[:, 1:]).min(0) < TOUCH
        assert {body for pair, touches in zip(pairs, touching, strict=True) if touches for body in pair} == set(
            range(objects)
        )
        assert np.abs(np.diff(track.poses[-3:], axis=0)).max() < 1e-4


def test_outcomes_of_controlled_scenes_depend_on_how_masses_compare_and_on_nothing_else_of_them() -> None:
    scene = controlled_scene(2)
    ends = {ratio: simulate(weighing(scene, (1.0, ratio))).poses[-1, 1:, :2] for ratio in (0.1, 0.9, 1.1, 9.0)}
    assert np.hypot(*(ends[0.1] - ends[9.0]).T).max() > 0.03
    assert 0.003 < np.hypot(*(ends[0.9] - ends[1.1]).T).max() < 0.03
    heavier = simulate(weighing(scene, (5.0, 5 * 1.1))).poses[-1, 1:, :2]
    assert np.hypot(*(ends[1.1] - heavier).T).max() < 1e-4


def test_controlled_scenes_of_other_numbers_are_refused_before_anything_is_written(tmp_path) -> None:
    with pytest.raises(SetupError, match="no controlled scene of 4 objects; valid: 2, 3"):
        controlled_scene(4)
    with pytest.raises(SetupError, match="setup 'controlled-masses': no scene of 9 objects; valid: 2, 3"):
        draw_trajectory("controlled-masses", 9, 0, 0)
    with pytest.raises(SetupError, match="valid: 2, 3"):
        generate("controlled-masses", 9, 1, 0, tmp_path / "nine.h5")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("setup", "objects"), [("different-masses", 4), ("controlled-masses", 3)])
def test_the_same_seed_and_index_give_the_same_bytes(setup: str, objects: int) -> None:
    drawn = [draw_trajectory(setup, objects, seed, 1).track for seed in (1, 1, 2)]
    assert drawn[0].poses.tobytes() == drawn[1].poses.tobytes()
    assert drawn[0].scene.to_json() == drawn[1].scene.to_json()
    assert drawn[0].poses.tobytes() != drawn[2].poses.tobytes()
