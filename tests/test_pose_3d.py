"""Poses in space form a group, NumPy and torch say the same, and both signs of a quaternion are one rotation."""

import numpy as np
import pytest
import torch

from pushgraph import pose_3d


def _poses(seed: int, count: int = 50) -> np.ndarray:
    values = np.random.default_rng(seed).normal(size=(count, 7))
    return pose_3d.normalized(values)


def _assert_same(a, b, tolerance: float = 1e-12) -> None:
    np.testing.assert_allclose(a[..., :3], b[..., :3], atol=tolerance)
    np.testing.assert_allclose(pose_3d.rotation_error(a, b), 0, atol=10 * tolerance)


IDENTITY = np.array([0, 0, 0, 1.0, 0, 0, 0])


def test_group():
    a, b, c = (_poses(seed) for seed in range(3))
    _assert_same(pose_3d.compose(pose_3d.compose(a, b), c), pose_3d.compose(a, pose_3d.compose(b, c)))
    _assert_same(pose_3d.compose(a, pose_3d.inverse(a)), np.broadcast_to(IDENTITY, a.shape))
    _assert_same(pose_3d.compose(a, IDENTITY), a)
    _assert_same(pose_3d.relative(a, b), pose_3d.compose(pose_3d.inverse(a), b))
    _assert_same(pose_3d.compose(a, pose_3d.relative(a, b)), b)


def test_points_follow_poses():
    a, b = _poses(0), _poses(1)
    points = np.random.default_rng(2).normal(size=(50, 3))
    inner = pose_3d.transform(b, points)
    np.testing.assert_allclose(pose_3d.transform(pose_3d.compose(a, b), points), pose_3d.transform(a, inner))
    matrices = pose_3d.rotation_matrix(a[:, 3:])
    np.testing.assert_allclose((matrices @ points[..., None])[..., 0], pose_3d.rotate(points, a[:, 3:]))


def test_quarter_turns_by_hand():
    about_z = pose_3d.from_rotation_vector(np.array([0, 0, np.pi / 2]))
    np.testing.assert_allclose(about_z, [np.sqrt(0.5), 0, 0, np.sqrt(0.5)])
    np.testing.assert_allclose(pose_3d.rotate(np.array([1.0, 0, 0]), about_z), [0, 1, 0], atol=1e-15)
    np.testing.assert_allclose(pose_3d.rotation_vector(-about_z), [0, 0, np.pi / 2])
    # A quarter of a circle of radius 2 about the point (0, 2): a screw without pitch.
    circle = pose_3d.exponential(np.array([np.pi, 0, 0, 0, 0, np.pi / 2]))
    np.testing.assert_allclose(circle[:3], [2, 2, 0], atol=1e-12)


@pytest.mark.parametrize("angle", [0.0, 1e-8, 0.0099, 0.0101, 1.0, 3.1])
def test_screws_add_up(angle):
    """Twice half a motion along a screw is the motion; rotation vectors lead there and back."""
    twist = np.concatenate((np.random.default_rng(0).normal(size=3), angle * np.array([2, -1, 2]) / 3))
    half = pose_3d.exponential(twist / 2)
    _assert_same(pose_3d.compose(half, half), pose_3d.exponential(twist), 1e-11)
    turn = pose_3d.from_rotation_vector(twist[3:])
    np.testing.assert_allclose(pose_3d.rotation_vector(turn), twist[3:], atol=1e-12)
    np.testing.assert_allclose(2 * np.arccos(min(turn[0], 1)), angle, atol=2e-8)


def test_signs_of_quaternions_do_not_matter():
    a, b = _poses(0), _poses(1)
    other = a * np.array([1, 1, 1, -1, -1, -1, -1])
    np.testing.assert_array_equal(pose_3d.rotation_error(a, b), pose_3d.rotation_error(other, b))
    np.testing.assert_array_equal(pose_3d.rotation_vector(a[:, 3:]), pose_3d.rotation_vector(other[:, 3:]))
    np.testing.assert_array_equal(pose_3d.transform(a, b[:, :3]), pose_3d.transform(other, b[:, :3]))


def test_torch_says_the_same_and_has_gradients_at_rest():
    a, b = _poses(0), _poses(1)
    torch_a, torch_b = torch.from_numpy(a), torch.from_numpy(b)
    for function in (pose_3d.compose, pose_3d.relative, pose_3d.rotation_error):
        np.testing.assert_allclose(function(torch_a, torch_b).numpy(), function(a, b), atol=1e-12)
    twists = np.random.default_rng(3).normal(size=(50, 6))
    np.testing.assert_allclose(pose_3d.exponential(torch.from_numpy(twists)).numpy(), pose_3d.exponential(twists))
    twist = torch.zeros(6, dtype=torch.float64, requires_grad=True)
    pose_3d.exponential(twist).sum().backward()
    np.testing.assert_allclose(twist.grad, [1, 1, 1, 0.5, 0.5, 0.5])
    assert torch.autograd.gradcheck(pose_3d.exponential, torch.from_numpy(twists[:3]).requires_grad_())
