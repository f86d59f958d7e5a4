from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from made_pushes import ends_of, made, rows_of, write

from pushgraph import pose
from pushgraph.adaptation.adapted import adapt, zero_shot
from pushgraph.adaptation.correction import Correction
from pushgraph.adaptation.files import load_adaptation, save_adaptation
from pushgraph.adaptation.fit import fit, linearized, residuals
from pushgraph.adaptation.gaussian_process import GaussianProcess
from pushgraph.adaptation.online import PushLearner
from pushgraph.adaptation.prediction import contact_points, predicted_motion
from pushgraph.adaptation.pressure import corners_of, feet, support
from pushgraph.adaptation.probe_offset import from_starts
from pushgraph.adaptation.recorded import pushes_of_tracks
from pushgraph.adaptation.scenes import scene_of
from pushgraph.adaptation.session import adapt_recorded
from pushgraph.adaptation.unknowns import COUNT, PROBE, Estimate, Unknowns
from pushgraph.body import Body
from pushgraph.errors import AdaptationError
from pushgraph.network.contract import Dynamics
from pushgraph.outline import centroid
from pushgraph.patch import patch_of
from pushgraph.physics import PhysicsPredictor
from pushgraph.real_pushes import RealPushes, read_pushes
from pushgraph.scene import Scene
from pushgraph.shape import Cuboid, Cylinder, Polygon
from pushgraph.tool import Push, Tool

SHAPES = (Cylinder(diameter=0.1), Cuboid(size=(0.12, 0.06)), Polygon(points=((0, 0), (0.12, 0), (0, 0.09))))


@pytest.fixture(scope="module")
def dynamics() -> Dynamics:
    return PhysicsPredictor.load().dynamics


@pytest.mark.parametrize("shape", SHAPES)
def test_uniform_pressure_has_the_moments_of_the_outline(shape) -> None:
    points, shares = feet(shape, 1.0, 0.0, (0.0, 0.0), rings=4, around=120)
    patch = patch_of([Body(name="a", shape=shape, pose_world_from_body=(0, 0, 0), mass=1.0)])
    np.testing.assert_allclose(shares @ points, patch.centre, atol=1e-6)
    away = points - patch.centre
    np.testing.assert_allclose((shares[:, None] * away).T @ away, patch.second_moments, rtol=0.02, atol=2e-6)


@pytest.mark.parametrize("shape", SHAPES)
def test_pressure_moves_out_and_about_its_centre(shape) -> None:
    middle = np.array(shape.centroid)
    spread = []
    for concentration in (0.1, 1.0, 3.0):
        points, shares = feet(shape, concentration, 0.2, (0.002, -0.001))
        np.testing.assert_allclose(shares @ points - middle, [0.002, -0.001], atol=1e-9)
        spread.append(shares @ np.linalg.norm(points - shares @ points, axis=1))
    assert spread[0] > spread[1] > spread[2]
    stands = np.array(support(shape, 0.5, 0.2, (0.002, -0.001)))
    np.testing.assert_allclose(stands.mean(0) - middle, [0.002, -0.001], atol=1e-9)


def test_scores_and_unknowns_are_inverse() -> None:
    unknowns = Unknowns(0.3, 0.5, 0.1, 0.001, -0.002, 1e-4, 2e-4)
    np.testing.assert_allclose(np.array(Unknowns.of(unknowns.scores)), unknowns)
    np.testing.assert_allclose(np.array(Unknowns.of(np.zeros(COUNT))), Unknowns())


def test_prediction_does_not_depend_on_where_and_how_the_object_lies(dynamics: Dynamics, tmp_path: Path) -> None:
    pushes = read_pushes(*write(tmp_path, rows_of(8, "box")))
    before = predicted_motion(dynamics, pushes)
    move = np.array([0.3, -0.2, 0.7])
    moved = [pose.compose(move, poses) for poses in (pushes.before, pushes.after)]
    ways = [pose.transform(move, points) for points in (pushes.probe_start, pushes.probe_end)]
    again = type(pushes)(
        pushes.shapes, pushes.surface, pushes.shape, pushes.speed, *moved, *ways, pushes.stated, pushes.probe_radius
    )
    np.testing.assert_allclose(predicted_motion(dynamics, again), before, atol=1e-6)
    assert (np.hypot(before[:, 0], before[:, 1]) > 1e-3).any()


def test_a_measured_offset_of_the_probe_is_where_it_truly_was(dynamics: Dynamics, tmp_path: Path) -> None:
    pushes = read_pushes(*write(tmp_path, rows_of(6, "disc")))
    offset = np.array([1e-3, -5e-4])
    shifted = type(pushes)(
        *(getattr(pushes, name) for name in ("shapes", "surface", "shape", "speed", "before", "after")),
        pushes.probe_start - offset,
        pushes.probe_end - offset,
        {},
    )
    told = predicted_motion(dynamics, shifted, Unknowns(probe_x=1e-3, probe_y=-5e-4))
    np.testing.assert_allclose(told, predicted_motion(dynamics, pushes), atol=1e-5)


def test_a_grain_lies_in_the_world_however_an_object_is_turned(dynamics: Dynamics, tmp_path: Path) -> None:
    pushes = read_pushes(*write(tmp_path, rows_of(4, "box")))
    unknowns = Unknowns(anisotropy_x=0.15, anisotropy_y=-0.18)
    told, even = (predicted_motion(dynamics, pushes, u) for u in (unknowns, Unknowns()))
    assert np.ptp(pushes.before[:, 2]) > 0.3
    effects = []
    for k in range(len(pushes)):
        scene = scene_of(pushes, k, unknowns)
        assert scene.table.anisotropy == pytest.approx(float(np.hypot(0.15, 0.18)))
        end = PhysicsPredictor.load().predict(scene).poses[-1, 1]
        off, effect = (np.abs(end - pose.compose(pushes.before[k], m[k])).max() for m in (told, even))
        assert off < 4e-3
        assert off <= effect / 3
        effects.append(effect)
    assert np.sort(effects)[2] > 5e-3  # one misses


def test_corners_bear_their_share() -> None:
    assert [len(corners_of(shape)) for shape in SHAPES] == [0, 4, 3]
    points, shares = feet(SHAPES[2], 1.0, 0.3, SHAPES[2].centroid)
    np.testing.assert_allclose(shares[-3:], 0.1)
    assert {tuple(p) for p in np.round(points[-3:] - SHAPES[2].centroid, 9)} == {(0, 0), (0.12, 0), (0, 0.09)}
    stands = np.array(support(SHAPES[1], 1.0, 0.5, (0.0, 0.0)))
    on_corner = np.isclose(np.abs(stands), [0.06, 0.03], atol=1e-9).all(1)
    assert on_corner.mean() == pytest.approx(0.5, abs=0.02)


def _starting(pushes: RealPushes, offset: np.ndarray) -> RealPushes:
    """The same pushes from where discs seem to be touched first, by a probe that truly is `offset` away."""
    ahead = (pushes.probe_end - pushes.probe_start) / np.linalg.norm(pushes.probe_end - pushes.probe_start, axis=1)[
        :, None
    ]
    shares = np.linspace(0, 0.05, 2001)[:, None]
    start = np.empty_like(pushes.probe_start)
    for k, (first, middle) in enumerate(zip(pushes.probe_start, pushes.before[:, :2], strict=True)):
        said = first + shares * ahead[k]
        gaps = [np.linalg.norm(where - middle, axis=1) - 0.05 - pushes.probe_radius for where in (said, said + offset)]
        start[k] = said[int(np.argmax((gaps[0] <= 0) | (gaps[1] <= 0)))]
    return replace(pushes, probe_start=start)


def test_where_pushes_start_tells_where_the_probe_is(tmp_path: Path) -> None:
    pushes = read_pushes(*write(tmp_path, rows_of(40, "disc")))
    offset = np.array([1.1e-3, -0.6e-3])
    found = from_starts(_starting(pushes, offset), Estimate.prior())
    np.testing.assert_allclose(found.unknowns[PROBE], offset, atol=2e-4)
    assert max(found.deviations[PROBE]) < 3e-4
    np.testing.assert_array_equal(found.mean[: PROBE.start], 0)
    assert found.unknowns.side_friction == Unknowns().side_friction


def test_starts_that_do_not_touch_tell_nothing(tmp_path: Path) -> None:
    pushes = read_pushes(*write(tmp_path, rows_of(40, "disc")))
    known = from_starts(pushes, Estimate.prior())
    np.testing.assert_array_equal(known.mean, 0)
    np.testing.assert_array_equal(known.covariance, Estimate.prior().covariance)


def test_first_contact_is_where_circle_and_outline_meet(tmp_path: Path) -> None:
    pushes = read_pushes(*write(tmp_path, rows_of(20, "disc")))
    distance = np.linalg.norm(contact_points(pushes), axis=1)
    np.testing.assert_allclose(distance, 0.05 + pushes.probe_radius, atol=1e-3)


def test_unknowns_are_found_again(dynamics: Dynamics, tmp_path: Path) -> None:
    true = Unknowns(0.12, 0.6, 0.2, 0.0, 0.0, 1.2e-3, -6e-4, 0.08, -0.05)
    pushes = read_pushes(*made(tmp_path, {"box": 40}, true, noise=2e-4))
    found = fit(dynamics, pushes, Estimate.prior().with_grain())
    off = (found.mean - true.scores) / np.sqrt(np.diag(found.covariance))
    assert np.abs(off).max() < 3
    assert abs(found.unknowns.side_friction - 0.12) < 0.03
    assert abs(found.unknowns.probe_x - 1.2e-3) < 5e-4
    assert abs(found.unknowns.anisotropy_x - 0.08) < 0.02
    assert abs(found.unknowns.anisotropy_y + 0.05) < 0.02
    assert found.lines()[0].startswith("side friction 0.1")
    assert found.lines()[-2].startswith("anisotropy x 0.0")
    even = fit(dynamics, pushes, Estimate.prior())
    assert even.lines()[-1].startswith("probe y")
    assert abs(even.unknowns.anisotropy_x) + abs(even.unknowns.anisotropy_y) < 1e-3


def test_a_grain_is_learnt_where_it_is_asked_for_and_written_into_scenes(dynamics: Dynamics, tmp_path: Path) -> None:
    pushes = read_pushes(*made(tmp_path, {"box": 20}, Unknowns(anisotropy_x=0.1, anisotropy_y=0.1), noise=2e-4))
    for grain, anisotropy in ((True, np.hypot(0.1, 0.1)), (False, 0.0)):
        scene = adapt(dynamics, pushes, grain=grain).apply_to(scene_of(pushes, 0))
        assert scene.table.anisotropy == pytest.approx(float(anisotropy), abs=0.04)
        if grain:
            assert scene.table.grain_world == pytest.approx(np.pi / 8, abs=0.15)


def test_without_pushes_that_tell_the_prior_stays(dynamics: Dynamics, tmp_path: Path) -> None:
    pushes = read_pushes(*write(tmp_path, rows_of(5, "disc")))
    far = type(pushes)(
        *(getattr(pushes, name) for name in ("shapes", "surface", "shape", "speed", "before", "after")),
        pushes.probe_start + 1.0,
        pushes.probe_end + 1.0,
        {},
    )
    found = fit(dynamics, far, Estimate.prior())
    np.testing.assert_allclose(found.mean, 0, atol=1e-9)
    np.testing.assert_allclose(found.covariance, Estimate.prior().covariance, atol=1e-9)


def test_derivatives_are_those_of_predictions(dynamics: Dynamics, tmp_path: Path) -> None:
    pushes = read_pushes(*write(tmp_path, rows_of(10, "box")))
    at = linearized(dynamics, pushes, np.zeros(COUNT))
    step = np.array([0.0, 0, 0, 0, 0, 0.1, 0, 0.03, -0.03])
    change = predicted_motion(dynamics, pushes, Unknowns.of(step)) - at.motion
    np.testing.assert_allclose(change, at.slope @ step, atol=1e-3)


def test_an_object_that_slipped_off_hardly_counts(dynamics: Dynamics, tmp_path: Path) -> None:
    pushes = read_pushes(*made(tmp_path, {"box": 30}, Unknowns(0.15), noise=2e-4))
    clean = fit(dynamics, pushes, Estimate.prior())
    pushes.after[3] += np.array([0.05, 0.05, 1.0])
    np.testing.assert_allclose(fit(dynamics, pushes, Estimate.prior()).mean, clean.mean, atol=0.4)


def test_left_out_errors_are_those_of_processes_without_the_sample() -> None:
    rng = np.random.default_rng(0)
    places, values = rng.normal(size=(12, 2)), rng.normal(size=(12, 3))
    process = GaussianProcess.fit(places, values)
    for k in (0, 7):
        others = np.delete(np.arange(12), k)
        x, y = torch.from_numpy(places[others]), torch.from_numpy(values[others])
        without = GaussianProcess.conditioned(x, y, process.logs)
        np.testing.assert_allclose(process.left_out[k], values[k] - without.mean(places[k : k + 1])[0], atol=1e-9)


def test_a_process_learns_a_smooth_function_and_is_unsure_elsewhere() -> None:
    places = np.linspace(-2, 2, 25)[:, None]
    process = GaussianProcess.fit(places, np.sin(places))
    np.testing.assert_allclose(process.mean(np.array([[0.55]])), np.sin([[0.55]]), atol=0.02)
    near, far = process.variance(np.array([[0.5], [50.0]]))
    assert near < 0.01 * far
    np.testing.assert_allclose(process.mean(np.array([[500.0]])), 0, atol=1e-6)


def test_a_correction_takes_away_an_error_that_repeats(dynamics: Dynamics, tmp_path: Path) -> None:
    pushes = read_pushes(*made(tmp_path, {"box": 60}))
    motion = pushes.motion * np.array([0.8, 0.8, 0.7])
    train, test = np.arange(40), np.arange(40, 60)
    correction = Correction.fit(pushes.take(train), motion[train])
    held_out = pushes.take(test)
    left = residuals(correction.motion(held_out, motion[test]), held_out)
    assert np.abs(left).mean() < 0.5 * np.abs(residuals(motion[test], held_out)).mean()
    assert np.abs(correction.left_out).mean() < np.abs(residuals(motion[test], held_out)).mean()


def test_an_adaptation_is_better_is_saved_and_is_read_the_same(dynamics: Dynamics, tmp_path: Path) -> None:
    pushes = read_pushes(*made(tmp_path, {"box": 40, "disc": 20}, Unknowns(0.1, 0.3, probe_x=1e-3), noise=3e-4))
    learnt = adapt(dynamics, pushes.take(np.arange(0, 60, 2)))
    held_out = pushes.take(np.arange(1, 60, 2))
    before, after = (
        np.hypot(*(one.predict(dynamics, held_out).ends - held_out.after)[:, :2].T).mean()
        for one in (zero_shot(held_out), learnt)
    )
    assert after < 0.6 * before
    save_adaptation(learnt, tmp_path / "a.safetensors", "hash", {"pushes": 30})
    again = load_adaptation(tmp_path / "a.safetensors", "hash")
    np.testing.assert_array_equal(learnt.predict(dynamics, held_out).ends, again.predict(dynamics, held_out).ends)
    with pytest.raises(AdaptationError, match="other physics weights"):
        load_adaptation(tmp_path / "a.safetensors", "another")
    (tmp_path / "b.safetensors").write_bytes(b"nothing")
    with pytest.raises(AdaptationError, match="cannot read"):
        load_adaptation(tmp_path / "b.safetensors")


def test_too_few_pushes_are_refused(dynamics: Dynamics, tmp_path: Path) -> None:
    with pytest.raises(AdaptationError, match="9 pushes: too few"):
        adapt(dynamics, read_pushes(*write(tmp_path, rows_of(9, "disc"))))


def test_pushes_that_are_watched_sharpen_what_is_believed(dynamics: Dynamics, tmp_path: Path) -> None:
    pushes = read_pushes(*write(tmp_path, rows_of(12, "box")))
    pushes.after[:] = ends_of(pushes, Unknowns(0.1))
    learner = PushLearner(dynamics)
    deviations = []
    for k in range(len(pushes)):
        scene = scene_of(pushes, k)
        found = learner.observe(scene, "box", pushes.before[k], pushes.after[k], scene.pushes[0])
        deviations.append(found.deviations.side_friction)
    assert deviations[-1] < deviations[0] < 0.2 * 0.3
    assert abs(found.unknowns.side_friction - 0.1) < abs(0.2 - 0.1) / 2
    applied = learner.apply_to(scene.replace(pushes=()))
    assert applied.side_friction == pytest.approx(found.unknowns.side_friction)
    assert len(applied.bodies[0].support) <= 64
    with pytest.raises(AdaptationError, match="straight"):
        learner.observe(scene, "box", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), Push(start=(0, 0), path=((0.1, 0), (0.1, 0.1))))


def test_centroid_of_a_support_is_that_of_its_shape() -> None:
    shape = SHAPES[2]
    np.testing.assert_allclose(
        np.mean(support(shape, 1.0, 0.3, (0.0, 0.0)), axis=0), centroid(np.array(shape.points)), atol=1e-9
    )


def test_unseen_shapes_are_predicted_by_what_is_known_of_their_surface(
    dynamics: Dynamics, tmp_path: Path
) -> None:
    pushes = read_pushes(*made(tmp_path, {"box": 15, "disc": 15}, Unknowns(0.1)))
    learnt = adapt(dynamics, pushes)
    assert learnt.of("abs", "box") is learnt.materials["abs", "box"]
    assert learnt.of("abs", "new") is learnt.surfaces["abs"]
    assert learnt.of("wood", "box") is learnt.shared
    assert learnt.surfaces["abs"].estimate.unknowns.side_friction == pytest.approx(Unknowns().side_friction)
    assert max(learnt.surfaces["abs"].widening) < 1  # they end where they should, but for friction
    scene = learnt.apply_to(scene_of(pushes, 0), "abs")
    assert scene.bodies[0].support is not None
    assert learnt.apply_to(scene_of(pushes, 0)) == scene  # there is but one surface
    with pytest.raises(AdaptationError, match="'wood' was not learnt of; learnt: abs"):
        learnt.apply_to(scene, "wood")
    with pytest.raises(AdaptationError, match="no body of the scene.*on 'abs': box, disc"):
        body = scene.bodies[0].replace(name="cup")
        learnt.apply_to(scene.replace(bodies=(body,)), "abs")


def test_tracks_of_single_bodies_are_pushes_to_learn_from(dynamics: Dynamics, tmp_path: Path) -> None:
    pushes = read_pushes(*write(tmp_path, rows_of(3, "box")))
    tracks = {f"{k}.h5": PhysicsPredictor.load().predict(scene_of(pushes, k)) for k in range(3)}
    found = pushes_of_tracks(tracks, "bench")
    assert found.materials == [("bench", "box")]
    assert found.probe_radius == pytest.approx(pushes.probe_radius)
    for k, track in enumerate(tracks.values()):
        np.testing.assert_allclose(found.before[k], track.poses[0, 1])
        np.testing.assert_allclose(found.after[k], track.poses[-1, 1], atol=1e-4)
        np.testing.assert_allclose(found.probe_end[k], track.scene.pushes[0].waypoints[-1, :2], atol=1e-4)
        assert found.speed[k] == pytest.approx(track.scene.pushes[0].speed, rel=0.2)
    two = Scene(
        bodies=tuple(
            Body(name=name, shape=Cuboid(size=(0.05, 0.05)), pose_world_from_body=(x, 0.0, 0.0), mass=0.5)
            for name, x in (("a", 0.0), ("b", 0.06))
        ),
        tool=Tool.round(0.0095),
        pushes=(Push(start=(-0.06, 0.0), end=(0.03, 0.0)),),
    ).with_nominal_values()
    with pytest.raises(AdaptationError, match="no push to learn from.*several bodies moved: 1"):
        pushes_of_tracks({"two.h5": PhysicsPredictor.load().predict(two)}, "bench")


def test_an_interrupted_adaptation_goes_on_with_what_was_learnt(tmp_path: Path) -> None:
    pushes = read_pushes(*made(tmp_path, {"box": 15, "disc": 15}, Unknowns(0.1)))
    whole = adapt_recorded(pushes, "made", tmp_path / "whole.safetensors")
    calls = []

    def killed(what: str, done: int, total: int) -> None:
        calls.append(what)
        if (what, done) == ("learnt", 2):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        adapt_recorded(pushes, "made", tmp_path / "again.safetensors", progress=killed)
    assert (tmp_path / "again.partial.safetensors").is_file()
    again = adapt_recorded(pushes, "made", tmp_path / "again.safetensors", progress=lambda what, *_: calls.append(what))
    assert calls.count("validated") == 3  # of the first run alone
    assert again.validation == whole.validation
    for name, own in whole.adaptation.materials.items():
        np.testing.assert_array_equal(own.estimate.mean, again.adaptation.materials[name].estimate.mean)
    assert not list(tmp_path.glob("*.partial*"))
