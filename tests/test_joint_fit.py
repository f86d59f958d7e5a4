"""Fits of joints to relative motion: exact where the motion is exact, as sure as they say where it is noisy."""

import math

import numpy as np
import pytest
import torch

from pushgraph import pose
from pushgraph.graph.broad_phase import LEVER
from pushgraph.graph.joint_fit import FIRST_COUNT, MEASURED, JointFits, RelativeMotion
from pushgraph.graph.scene_batch import Relations
from pushgraph.graph.watching import CameraNoise

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


def test_the_camera_s_noise_is_found_from_what_rests() -> None:
    rng = np.random.default_rng(1)
    size = np.array([0.001, 0.001, 0.009])
    places = torch.tensor(rng.uniform(-1, 1, (2, 5, 3)))
    yaw_known = torch.tensor([[True, True, True, True, False]] * 2)
    noise = CameraNoise(*[torch.zeros(2, 2, dtype=torch.float64)] * 2)
    assert noise.spread.tolist() == [[0, 0], [0, 0]]
    mean, rested = places + torch.tensor(rng.normal(size=(2, 5, 3)) * size), torch.ones(2, 5, dtype=torch.float64)
    for _ in range(200):
        seen = places + torch.tensor(rng.normal(size=(2, 5, 3)) * size)
        seen[0, 1] += 0.3  # moves: it does not rest
        seen[:, 4, 2] += 1.0  # turns, as far as one can see
        rests = rested * torch.tensor([[1, 0, 1, 1, 1], [1, 1, 1, 1, 1]])
        noise = noise.observe(seen - mean, rests, yaw_known)
        rested = rested + 1
        mean = mean + (seen - mean) / rested[..., None]
        mean[0, 1] = places[0, 1]
    np.testing.assert_allclose(noise.spread.numpy(), [[0.001, 0.009]] * 2, rtol=0.08)
