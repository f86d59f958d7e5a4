"""Fits of joints to relative motion: exact where the motion is exact, as sure as they say where it is noisy."""

import math

import numpy as np
import pytest
import torch

from pushgraph import pose
from pushgraph.graph.broad_phase import LEVER
from pushgraph.graph.camera_noise import FINEST, CameraNoise
from pushgraph.graph.joint_fit import FIRST_COUNT, MEASURED, JointFits, RelativeMotion
from pushgraph.graph.misfit import Misfit, misfit
from pushgraph.graph.scene_batch import Relations

ANCHOR_A, ANCHOR_B, OFFSET = (0.05, 0.01), (-0.06, 0.02), 0.4


ACROSS = torch.tensor([[1j]], dtype=torch.complex128)
"""What a line is taken for before anything has moved."""


def one_pair() -> Relations:
    """Two bodies that faced each other at ANCHOR_A, in the frame of the first, when their memory began."""
    yes = torch.ones(1, 1, dtype=torch.bool)
    zeros = torch.zeros(1, 1, 2, dtype=torch.float64)
    anchors = (torch.tensor([[anchor]], dtype=torch.float64) for anchor in (ANCHOR_A, ANCHOR_B))
    return Relations(yes.long(), ~yes, yes, *anchors, torch.tensor([[OFFSET]], dtype=torch.float64), zeros, zeros)


def first_pose_a_from_b() -> np.ndarray:
    place = np.array(ANCHOR_A) - pose.rotate(np.array(ANCHOR_B), OFFSET)
    return np.array([*place, OFFSET])


def watched(poses_a_from_b: np.ndarray, pose_world_from_a: tuple[float, float, float] = (0.3, -0.2, 1.1)) -> JointFits:
    """Fits to a pair that moved from the first frame on."""
    relations, moved = one_pair(), torch.ones(1, 1, dtype=torch.bool)
    fits = JointFits.begin(moved)
    for relative in poses_a_from_b:
        parent = np.array(pose_world_from_a)
        poses = torch.tensor(np.stack((parent, pose.compose(parent, relative)))[None])
        fits = fits.observe(RelativeMotion.of(relations, poses), moved)
    return fits


def swung(pivot: tuple[float, float], turns: np.ndarray) -> np.ndarray:
    """Poses of b in the frame of a as it turns about a point fixed in both."""
    start, pivot = first_pose_a_from_b(), np.array(pivot)
    places = [[*(pivot + pose.rotate(start[:2] - pivot, turn)), start[2] + turn] for turn in turns]
    return np.array(places)


@pytest.mark.parametrize("pivot", [(0.05, 0.01), (-0.03, 0.08), (0.2, -0.1)])
def test_a_hinge_anywhere_is_found_exactly(pivot: tuple[float, float]) -> None:
    fits = watched(swung(pivot, np.linspace(0, 0.6, 40)))
    hinge = fits.hinge()
    for anchor in (hinge.anchor_a, hinge.anchor_b):
        found = np.array(ANCHOR_A) + torch.view_as_real(anchor)[0, 0].numpy()
        np.testing.assert_allclose(found, pivot, atol=3e-4)
    assert float(hinge.residual) < 2e-4
    assert float(fits.highest_turn) == pytest.approx(0.6)
    assert float(fits.lowest_turn) == pytest.approx(0, abs=1e-9)
    # No line passes through an arc, unless it is short.
    if pivot != (0.05, 0.01):
        assert float(fits.slider(ACROSS).across) > 10 * float(hinge.residual)


@pytest.mark.parametrize("angle", [0.0, 1.0, -1.4, 3.0])
def test_a_slider_in_any_direction_is_found_exactly(angle: float) -> None:
    way = np.array([math.cos(angle), math.sin(angle)])
    start = first_pose_a_from_b()
    places = np.array([[*(start[:2] + far * way), start[2]] for far in np.linspace(-0.02, 0.06, 50)])
    fits = watched(places)
    slider = fits.slider(ACROSS)
    assert abs((slider.axis[0, 0].conj() * complex(*way)).real) == pytest.approx(1, abs=1e-5)
    assert float(slider.across) < 1e-4
    assert float(fits.turn_spread) < 1e-6
    ends = torch.stack((fits.first_drift, fits.last_drift)) * complex(*way).conjugate()
    assert sorted(ends.real.flatten().tolist()) == pytest.approx([-0.02, 0.06])
    assert float(fits.hinge().residual) > 1e-3


def test_what_is_fixed_fits_everything_and_what_is_free_fits_nothing() -> None:
    still = watched(np.repeat(first_pose_a_from_b()[None], 20, 0))
    assert max(float(still.drift_spread), float(still.turn_spread), float(still.hinge().residual)) < 1e-6
    free = swung((0.05, 0.01), np.linspace(0, 0.5, 40))
    free[20:, :2] += np.linspace(0, 0.08, 20)[:, None]
    fits = watched(free)
    assert float(fits.hinge().residual) > 0.004
    assert float(fits.slider(ACROSS).across) + LEVER * float(fits.turn_spread) > 0.004


def test_fits_do_not_depend_on_where_the_pair_stands_and_wait_while_nothing_moves() -> None:
    places = swung((-0.03, 0.08), np.linspace(0, 0.6, 15))
    here, there = watched(places), watched(places, (-1.0, 2.0, -2.5))
    for one, other in zip(here, there, strict=True):
        torch.testing.assert_close(one, other, atol=1e-9, rtol=0)
    rests = torch.zeros(1, 1, dtype=torch.bool)
    motion = RelativeMotion.of(one_pair(), torch.tensor([[[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]], dtype=torch.float64))
    for one, other in zip(here, here.observe(motion, rests), strict=True):
        torch.testing.assert_close(one, other)
    assert float(here.frames) == FIRST_COUNT + 15


def test_the_anchor_is_as_uncertain_as_the_fit_says() -> None:
    rng = np.random.default_rng(0)
    pivot = (-0.01, 0.05)
    clean = swung(pivot, np.linspace(0, 0.4, 60))
    errors, spreads = [], []
    for _ in range(60):
        hinge = watched(clean + rng.normal(size=clean.shape) * [1.5 * MEASURED, 1.5 * MEASURED, 0.0]).hinge()
        found = torch.view_as_real((hinge.anchor_a + hinge.anchor_b) / 2)[0, 0].numpy() + ANCHOR_A
        errors.append(found - pivot)
        spreads.append(float(hinge.spread))
    assert 0.7 < np.std(errors) / np.mean(spreads) < 1.3


RESTED, DRAWS = 5.0, 400
POSITION_NOISE, YAW_NOISE = 0.001, 0.009


def line_of_centres() -> complex:
    return complex(*first_pose_a_from_b()[:2])


def misfit_of(clean: np.ndarray) -> Misfit:
    """Of DRAWS pairs that a camera watches; the place where each memory began is the mean of RESTED sightings."""
    rng = np.random.default_rng(3)
    size = np.array([POSITION_NOISE, POSITION_NOISE, YAW_NOISE])
    moved = torch.ones(DRAWS, 1, dtype=torch.bool)
    # What is wrong with where b was taken to begin is wrong with all drifts.
    begun = rng.normal(size=(DRAWS, 3)) * size * math.sqrt(2 / RESTED)
    fits = JointFits.begin(moved)._replace(rested=torch.full((DRAWS, 1), RESTED, dtype=torch.float64))
    parent = np.zeros(3)
    for relative in clean:
        seen = np.stack((np.zeros((DRAWS, 3)), pose.compose(parent, relative) + begun), 1)
        seen += rng.normal(size=seen.shape) * size
        last = fits, RelativeMotion.of(one_pair(), torch.tensor(seen))
        fits = fits.observe(last[1], moved)
    levers = sum(x * x for x in (*ANCHOR_A, *ANCHOR_B))
    drift_noise = torch.full((DRAWS, 1), math.sqrt(2 * POSITION_NOISE**2 + levers / 2 * YAW_NOISE**2))
    turn_noise = torch.full((DRAWS, 1), math.sqrt(2) * YAW_NOISE)
    centres = torch.full((DRAWS, 1), line_of_centres(), dtype=torch.complex128)
    return misfit(last[0], last[1], torch.ones(DRAWS, 1), drift_noise, turn_noise, centres)


def test_what_noise_explains_is_about_one_standard_deviation_off() -> None:
    off = misfit_of(np.repeat(first_pose_a_from_b()[None], 40, 0))
    for name in ("fixed_drift", "fixed_turn", "hinge", "slider", "along_centres"):
        values = getattr(off, name)
        assert abs(float(values.mean())) < 0.6, name
        assert 0.6 < float(values.std()) < 1.6, name
    for name in ("mean_turn", "recent_turn", "slow_turn", "turn", "tilt"):  # absolute values of standard normal numbers
        assert 0.6 < float(getattr(off, name).square().mean()) < 1.5, name
    for name in ("mean_drift", "recent_drift", "slow_drift", "drift"):  # lengths of standard normal vectors
        assert 1.2 < float(getattr(off, name).square().mean()) < 3.0, name
    # A running mean is a part of the mean that it is held against.
    assert float(off.shift_turn.square().mean()) < 1
    assert float(off.shift_drift.square().mean()) < 2


@pytest.mark.parametrize("joint", ["revolute", "prismatic"])
def test_a_joint_that_moved_a_little_fits_and_fixed_does_not(joint: str) -> None:
    if joint == "revolute":
        places = swung((0.0, 0.03), np.linspace(0, 0.1, 40))
    else:
        places = np.repeat(first_pose_a_from_b()[None], 40, 0)
        places[:, :2] += np.outer(np.linspace(0, 0.012, 40), (0.6, 0.8))
    off = misfit_of(places)
    turns = off.fixed_turn, off.mean_turn, off.recent_turn
    drifts = off.fixed_drift, off.mean_drift, off.recent_drift
    fits, others = (off.hinge, turns) if joint == "revolute" else (off.slider, drifts)
    assert abs(float(fits.mean())) < 1
    for other in others:
        assert float(other.mean()) > 3


def test_what_moves_late_is_told_though_where_it_began_was_hardly_seen() -> None:
    places = np.repeat(first_pose_a_from_b()[None], 80, 0)
    places[50:, 0] += 0.002
    off = misfit_of(places)
    assert float(off.shift_drift.mean()) > 1.3 * float(off.slow_drift.mean())


@pytest.mark.parametrize(("degrees", "along_line"), [(0.0, True), (180.0, True), (15.0, False), (-15.0, False)])
def test_a_slide_along_the_line_of_centres_is_told_from_one_that_is_tilted(degrees: float, along_line: bool) -> None:
    places = np.repeat(first_pose_a_from_b()[None], 40, 0)
    way = line_of_centres() / abs(line_of_centres()) * np.exp(1j * np.radians(degrees))
    places[:, :2] += np.outer(np.linspace(0, 0.02, 40), (way.real, way.imag))
    off = misfit_of(places)
    assert abs(float(off.slider.mean())) < 1
    if along_line:
        assert 0.6 < float(off.tilt.square().mean()) < 1.5
        assert abs(float(off.along_centres.mean())) < 1
    else:
        assert float(off.tilt.mean()) > 3
        assert float(off.along_centres.mean()) > 1


def test_the_camera_s_noise_is_found_from_what_rests() -> None:
    rng = np.random.default_rng(1)
    size = np.array([0.001, 0.001, 0.009])
    places = torch.tensor(rng.uniform(-1, 1, (2, 5, 3)))
    yaw_known = torch.tensor([[True, True, True, True, False]] * 2)
    noise = CameraNoise.begin(places)
    assert noise.spread.tolist() == [[0, 0], [0, 0]]
    mean, rested = places + torch.tensor(rng.normal(size=(2, 5, 3)) * size), torch.ones(2, 5, dtype=torch.float64)
    for _ in range(200):
        seen = places + torch.tensor(rng.normal(size=(2, 5, 3)) * size)
        seen[0, 1] += 0.3  # moves: it does not rest
        seen[:, 4, 2] += 1.0  # turns, as far as one can see
        rests = rested * torch.tensor([[1, 0, 1, 1, 1], [1, 1, 1, 1, 1]])
        noise = noise.observe_rest(seen - mean, rests, yaw_known)
        rested = rested + 1
        mean = mean + (seen - mean) / rested[..., None]
        mean[0, 1] = places[0, 1]
    np.testing.assert_allclose(noise.spread.numpy(), [[0.001, 0.009]] * 2, rtol=0.08)


def test_the_camera_s_noise_is_found_where_nothing_rests() -> None:
    rng = np.random.default_rng(4)
    size = np.array([0.001, 0.001, 0.009])
    yaw_known = torch.tensor([[True, True, True, True, False]])
    moves = torch.tensor([[True, True, True, True, True]])
    steps = np.arange(42)[:, None, None]
    seen = rng.uniform(-1, 1, (5, 3)) + steps * rng.uniform(-0.01, 0.01, (5, 3)) + rng.normal(size=(42, 5, 3)) * size
    seen[20:, 0, 0] += 0.004 * np.arange(22) ** 2  # one is pushed on faster and faster
    seen[:, 4, 2] = 0.0  # shows no yaw
    noise = CameraNoise.begin(torch.tensor(seen[:1]))
    for bend in torch.tensor(np.diff(seen, n=2, axis=0)):
        noise = noise.observe_bends(bend[None], moves, yaw_known)
    np.testing.assert_allclose(noise.spread.numpy(), [[0.001, 0.009]], rtol=0.25)
    unseen = noise.observe_bends(torch.zeros(1, 5, 3, dtype=torch.float64), torch.zeros_like(moves), yaw_known)
    assert (unseen.spread == noise.spread).all()


@pytest.mark.parametrize(
    ("jitter", "camera_error", "unseen"),
    [(0.0, FINEST, FINEST), (1e-4, FINEST, 1.5e-4), (0.001, FINEST, 3e-4), (0.001, 5e-4, 5e-4), (1e-4, 3e-4, 3e-4)],
)
def test_errors_that_do_not_jitter_are_expected_beside_those_that_do(jitter, camera_error, unseen) -> None:
    noise = CameraNoise.begin(torch.zeros(1, 2, 3, dtype=torch.float64), camera_error)
    spread = torch.tensor([[jitter, jitter / LEVER]], dtype=torch.float64)
    expected = jitter**2 + unseen**2
    torch.testing.assert_close(noise.variance(spread), torch.tensor([[expected, expected / LEVER**2]]).double())
