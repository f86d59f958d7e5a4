"""Group laws of planar poses, the same in NumPy and torch."""

import math

import numpy as np
import pytest
import torch

from pushgraph.pose import compose, inverse, relative, rotate, transform, wrap_angle


@pytest.fixture
def poses() -> np.ndarray:
    return np.random.default_rng(0).uniform(-3, 3, (3, 50, 3))


def test_composition_is_associative_and_inverse_undoes_it(poses: np.ndarray) -> None:
    a, b, c = poses
    np.testing.assert_allclose(compose(compose(a, b), c), compose(a, compose(b, c)), atol=1e-12)
    np.testing.assert_allclose(compose(a, inverse(a)), 0, atol=1e-12)
    np.testing.assert_allclose(relative(a, compose(a, b)), b, atol=1e-12)


def test_transform_composes_like_poses(poses: np.ndarray) -> None:
    a, b, c = poses
    np.testing.assert_allclose(transform(compose(a, b), c[:, :2]), transform(a, transform(b, c[:, :2])), atol=1e-12)


def test_a_quarter_turn_by_hand() -> None:
    np.testing.assert_allclose(rotate(np.array([1.0, 2.0]), math.pi / 2), [-2, 1], atol=1e-15)
    moved = compose(np.array([1.0, 2.0, math.pi / 2]), np.array([3.0, 0.0, 0.5]))
    np.testing.assert_allclose(moved, [1, 5, math.pi / 2 + 0.5])


def test_torch_gives_the_same_and_broadcasts(poses: np.ndarray) -> None:
    a, b = torch.from_numpy(poses[0]), torch.from_numpy(poses[1])
    np.testing.assert_allclose(compose(a[:1], b), compose(poses[0, :1], poses[1]))
    np.testing.assert_allclose(relative(a[:1, None], b), relative(poses[0, :1, None], poses[1]))


def test_wrapped_angles_are_the_same_angles() -> None:
    angles = np.linspace(-20, 20, 101)
    wrapped = wrap_angle(angles)
    assert np.abs(wrapped).max() <= math.pi + 1e-12
    np.testing.assert_allclose(np.cos(wrapped - angles), 1)
