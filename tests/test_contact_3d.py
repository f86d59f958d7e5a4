"""Contacts of boxes: against an independent library, by hand, and laws."""

import numpy as np
import pytest
import torch

from pushgraph import pose_3d
from pushgraph.contact_3d import contact_between
from pushgraph.contact_patch import contact_patch


def _boxes(seed: int, count: int, spread: float) -> tuple[torch.Tensor, torch.Tensor]:
    rng = np.random.default_rng(seed)
    poses = pose_3d.normalized(np.concatenate((rng.normal(size=(count, 3)) * spread, rng.normal(size=(count, 4))), 1))
    return torch.from_numpy(poses), torch.from_numpy(rng.uniform(0.02, 0.3, (count, 3)))


def _both(seed: int, count: int = 400, spread: float = 0.4) -> tuple[torch.Tensor, ...]:
    return *_boxes(seed, count, spread), *_boxes(seed + 1, count, spread)


def test_gaps_and_depths_are_those_of_fcl():
    fcl = pytest.importorskip("fcl")
    boxes = _both(0, spread=0.2)
    found = contact_between(*boxes)
    for k, (pose_a, half_a, pose_b, half_b) in enumerate(zip(*(values.numpy() for values in boxes), strict=True)):
        a, b = (
            fcl.CollisionObject(fcl.Box(*(2 * half)), fcl.Transform(pose[3:], pose[:3]))
            for pose, half in ((pose_a, half_a), (pose_b, half_b))
        )
        result = fcl.DistanceResult()
        distance = fcl.distance(a, b, fcl.DistanceRequest(enable_nearest_points=True), result)
        if distance > 0:
            assert float(found.gap[k]) == pytest.approx(distance, abs=1e-6), k
        else:
            contacts = fcl.CollisionResult()
            fcl.collide(a, b, fcl.CollisionRequest(num_max_contacts=1000, enable_contact=True), contacts)
            depth = max(contact.penetration_depth for contact in contacts.contacts)
            # The library prefers faces by some percent.
            assert float(-found.gap[k]) == pytest.approx(depth, rel=0.06, abs=1e-6), k
    assert 0.2 < float((found.gap < 0).double().mean()) < 0.8


def test_moving_apart_by_the_depth_parts():
    """A box that moves along the normal by the gap touches: the gap is then zero, whether they overlapped or not."""
    pose_a, half_a, pose_b, half_b = _both(2)
    found = contact_between(pose_a, half_a, pose_b, half_b)
    torch.testing.assert_close(found.point_b - found.point_a, found.gap[:, None] * found.normal)
    moved = pose_b.clone()
    moved[:, :3] -= found.gap[:, None] * found.normal * (1 + 1e-9)
    after = contact_between(pose_a, half_a, moved, half_b)
    np.testing.assert_allclose(after.gap, 0, atol=1e-7)
    # The points are on both boxes.
    for pose, half, point in ((pose_a, half_a, found.point_a), (pose_b, half_b, found.point_b)):
        local = pose_3d.transform(pose_3d.inverse(pose), point).abs()
        on = (local <= half + 1e-9).all(-1) & ((local - half).abs() < 1e-9).any(-1)
        assert float(on[found.gap > 0].double().mean()) == 1
        assert float(on.double().mean()) > 0.99


def test_order_and_sign_of_quaternions_do_not_matter():
    pose_a, half_a, pose_b, half_b = _both(4)
    found, back = contact_between(pose_a, half_a, pose_b, half_b), contact_between(pose_b, half_b, pose_a, half_a)
    torch.testing.assert_close(found.gap, back.gap)
    torch.testing.assert_close(found.normal, -back.normal)
    flipped = torch.cat((pose_a[:, :3], -pose_a[:, 3:]), 1)
    torch.testing.assert_close(contact_between(flipped, half_a, pose_b, half_b).gap, found.gap, rtol=0, atol=0)


def test_a_box_on_a_larger_one_rests_on_its_corners():
    below = torch.tensor([0, 0, 0, 1.0, 0, 0, 0], dtype=torch.float64)
    above = torch.tensor([0.01, 0, 0.0249, 1.0, 0, 0, 0], dtype=torch.float64)
    half_below, half_above = torch.tensor([[0.1, 0.1, 0.02], [0.05, 0.04, 0.005]], dtype=torch.float64)
    ways = ((below, half_below, above, half_above, 1), (above, half_above, below, half_below, -1))
    for a, half_a, b, half_b, up in ways:
        patch = contact_patch(a, half_a, b, half_b)
        points = patch.point[patch.touches]
        torch.testing.assert_close(patch.normal, torch.tensor([0, 0, up], dtype=torch.float64))
        torch.testing.assert_close(patch.gap[patch.touches], torch.full((4,), -1e-4, dtype=torch.float64))
        found = {tuple(np.round(point[:2].tolist(), 9) + 0.0) for point in points}
        assert found == {(-0.04, -0.04), (-0.04, 0.04), (0.06, -0.04), (0.06, 0.04)}


def test_a_cross_touches_where_outlines_cross():
    """Two beams on each other: four points, none of them a corner of either."""
    below = torch.tensor([0, 0, 0, 1.0, 0, 0, 0], dtype=torch.float64)
    above = torch.tensor([0, 0, 0.02, 1.0, 0, 0, 0], dtype=torch.float64)
    half = torch.tensor([[0.1, 0.01, 0.01], [0.02, 0.1, 0.01]], dtype=torch.float64)
    patch = contact_patch(below, half[0], above, half[1])
    found = {tuple(np.round(point.tolist(), 9) + 0.0) for point in patch.point[patch.touches]}
    assert found == {(x, y, 0.01) for x in (-0.02, 0.02) for y in (-0.01, 0.01)}


def test_gradients():
    pose_a, half_a, pose_b, half_b = _both(6, 8)
    pose_b.requires_grad_()
    assert torch.autograd.gradcheck(lambda pose: contact_between(pose_a, half_a, pose, half_b).gap, pose_b)
