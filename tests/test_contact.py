"""Contact geometry against shapely, separating axes, finite differences and cases worked by hand."""

import inspect
import math

import numpy as np
import pytest
import shapely
import torch
from scipy.spatial import ConvexHull

from pushgraph.contact import RoundedBox, contact_between, signed_gap
from pushgraph.errors import GeometryError
from pushgraph.pose import compose, inverse, relative, transform


def random_boxes(rng: np.random.Generator, count: int) -> RoundedBox:
    cylinder = rng.random(count) < 0.5
    half = rng.uniform(0.005, 0.1, (count, 2))
    return RoundedBox(
        torch.tensor(np.where(cylinder[:, None], 0.0, half)),
        torch.tensor(np.where(cylinder, rng.uniform(0.005, 0.1, count), 0.0)),
    )


def random_pairs(seed: int, count: int, reach: float = 0.25) -> tuple[RoundedBox, RoundedBox, torch.Tensor]:
    rng = np.random.default_rng(seed)
    a, b = random_boxes(rng, count), random_boxes(rng, count)
    pose = np.column_stack((rng.uniform(-reach, reach, (count, 2)), rng.uniform(-math.pi, math.pi, count)))
    return a, b, torch.tensor(pose)


def corners(half: np.ndarray, pose: np.ndarray) -> np.ndarray:
    square = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * half
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    return square @ np.array([[cos, sin], [-sin, cos]]) + pose[:2]


def reference_gap(half_a: np.ndarray, half_b: np.ndarray, pose: np.ndarray, radii: float) -> float:
    """Distance of the two cores by shapely; if they overlap, depth of the origin in their Minkowski difference."""
    core_a = shapely.convex_hull(shapely.multipoints(corners(half_a, np.zeros(3))))
    core_b = shapely.convex_hull(shapely.multipoints(corners(half_b, pose)))
    distance = core_a.distance(core_b)
    if distance > 0:
        return distance - radii
    difference = (corners(half_b, pose)[:, None] - corners(half_a, np.zeros(3))[None]).reshape(-1, 2)
    return ConvexHull(difference).equations[:, 2].max() - radii


def test_gap_matches_shapely_and_separating_axes_over_100000_random_pairs() -> None:
    a, b, pose = random_pairs(0, 100_000)
    ours = contact_between(a, b, pose)
    half_a, half_b = a.half_extents.numpy(), b.half_extents.numpy()
    radii = (a.radius + b.radius).numpy()
    expected = np.array([reference_gap(*row) for row in zip(half_a, half_b, pose.numpy(), radii, strict=True)])
    assert (expected < 0).mean() > 0.15
    np.testing.assert_allclose(ours.gap.numpy(), expected, atol=1e-6)
    np.testing.assert_allclose(signed_gap(a, b, pose).numpy(), expected, atol=1e-6)
    single = contact_between(RoundedBox(*(t.float() for t in a)), RoundedBox(*(t.float() for t in b)), pose.float())
    np.testing.assert_allclose(single.gap.numpy(), expected, atol=1e-5)


def cylinder(diameter: float) -> RoundedBox:
    return RoundedBox(torch.zeros(2, dtype=torch.float64), torch.tensor(diameter / 2, dtype=torch.float64))


def cuboid(x: float, y: float) -> RoundedBox:
    half = torch.tensor([x / 2, y / 2], dtype=torch.float64)
    return RoundedBox(half, torch.tensor(0.0, dtype=torch.float64))


def at(x: float, y: float, yaw: float = 0.0) -> torch.Tensor:
    return torch.tensor([x, y, yaw], dtype=torch.float64)


def close(actual: torch.Tensor, expected: list) -> None:
    np.testing.assert_allclose(actual.numpy(), expected, atol=1e-9)


def test_two_cylinders_by_hand() -> None:
    result = contact_between(cylinder(0.1), cylinder(0.06), at(0.0, 0.1))
    close(result.gap, 0.02)
    close(result.normal, [0, 1])
    close(result.gaps, [0.02, 0.02])
    close(result.points_a, [[0, 0.05], [0, 0.05]])
    close(result.points_b, [[0, 0.07], [0, 0.07]])


def test_cylinder_beside_the_corner_of_a_cuboid_by_hand() -> None:
    result = contact_between(cuboid(0.2, 0.1), cylinder(0.04), at(0.13, 0.09))
    close(result.gap, 0.05 - 0.02)
    close(result.normal, [0.6, 0.8])
    close(result.points_a[0], [0.1, 0.05])


def test_cylinder_inside_a_cuboid_leaves_by_the_nearest_face() -> None:
    result = contact_between(cuboid(0.2, 0.1), cylinder(0.04), at(0.02, 0.04))
    close(result.gap, -0.01 - 0.02)
    close(result.normal, [0, 1])
    close(result.points_a[0], [0.02, 0.05])
    close(result.points_b[0], [0.02, 0.02])


def test_faces_that_look_at_each_other_touch_at_the_two_ends_of_the_stretch() -> None:
    result = contact_between(cuboid(0.2, 0.1), cuboid(0.2, 0.1), at(0.12, 0.11))
    close(result.gaps, [0.01, 0.01])
    close(result.normal, [0, 1])
    ends = result.points_a[result.points_a[:, 0].argsort()]
    close(ends, [[0.02, 0.05], [0.1, 0.05]])


def test_second_contact_of_a_tilted_cuboid_is_the_other_end_of_its_face() -> None:
    tilt = 0.1
    height = 0.05 + 0.05 * math.cos(tilt) + 0.1 * math.sin(tilt) + 0.01
    result = contact_between(cuboid(1.0, 0.1), cuboid(0.2, 0.1), at(0.0, height, tilt))
    close(result.gaps, [0.01, 0.01 + 0.2 * math.sin(tilt)])


@pytest.mark.parametrize("offset", [0.0, 1e-12, -1e-12])
def test_overlapping_crossed_bars_part_by_the_smallest_translation(offset: float) -> None:
    result = contact_between(cuboid(0.4, 0.02), cuboid(0.02, 0.3), at(0.0, offset))
    close(result.gap, -0.16)


def test_gap_is_symmetric_and_the_normal_turns_round() -> None:
    a, b, pose_a_from_b = random_pairs(1, 5_000)
    there, back = contact_between(a, b, pose_a_from_b), contact_between(b, a, inverse(pose_a_from_b))
    np.testing.assert_allclose(there.gap, back.gap, atol=1e-6)
    unique = (there.gap > 1e-3).numpy()
    normal_back = transform(pose_a_from_b, back.normal) - pose_a_from_b[:, :2]
    np.testing.assert_allclose(there.normal[unique], -normal_back[unique], atol=1e-6)


def test_first_contact_joins_the_two_surfaces_along_the_normal() -> None:
    a, b, pose = random_pairs(2, 20_000)
    result = contact_between(a, b, pose)
    joined = result.points_a[:, 0] + result.gap[:, None] * result.normal
    np.testing.assert_allclose(joined, result.points_b[:, 0], atol=1e-9)
    np.testing.assert_allclose(torch.linalg.vector_norm(result.normal, dim=-1), 1, atol=1e-12)
    assert (result.gaps[:, 1] >= result.gap - 1e-6).all()
    cores = a.half_extents - result.points_a[:, 0].abs()
    outside = torch.linalg.vector_norm((-cores).clamp(min=0), dim=-1)
    parted = result.gap > 0
    np.testing.assert_allclose(outside[parted], a.radius[parted], atol=1e-9)


def test_gap_changes_no_faster_than_the_shapes_move() -> None:
    a, b, pose = random_pairs(3, 20_000)
    step = torch.tensor(np.random.default_rng(4).normal(size=(20_000, 2)) * 1e-3)
    moved = torch.cat((pose[:, :2] + step, pose[:, 2:]), -1)
    change = (signed_gap(a, b, moved) - signed_gap(a, b, pose)).abs()
    assert (change <= torch.linalg.vector_norm(step, dim=-1) + 1e-6).all()


def test_gradient_matches_finite_differences() -> None:
    a, b, pose = random_pairs(5, 4_000)
    pose.requires_grad_()
    signed_gap(a, b, pose).sum().backward()
    numeric = torch.empty_like(pose)
    h = 1e-6
    with torch.no_grad():
        for axis in range(3):
            step = torch.zeros(3, dtype=torch.float64)
            step[axis] = h
            numeric[:, axis] = (signed_gap(a, b, pose + step) - signed_gap(a, b, pose - step)) / (2 * h)
    wrong = ((pose.grad - numeric).abs() > 1e-4).any(-1)
    # Where two nearest features tie within h, the difference straddles a kink.
    assert wrong.double().mean() < 0.002


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_gradient_of_every_output_reaches_sizes_and_poses_and_is_finite_at_degenerate_poses(dtype: torch.dtype) -> None:
    shapes = [cylinder(0.1), cylinder(0.02), cuboid(0.1, 0.1), cuboid(0.2, 0.04)]
    poses = [at(0, 0), at(0, 0, math.pi / 4), at(0.1, 0), at(0, 0.1), at(0.05, 0.05), at(0.06, 0), at(0.15, 0.07)]
    for a in shapes:
        for b in shapes:
            for pose in poses:
                leaves = [t.to(dtype).clone().requires_grad_() for t in (*a, *b, pose)]
                result = contact_between(RoundedBox(*leaves[:2]), RoundedBox(*leaves[2:4]), leaves[4])
                sum(output.sum() for output in result).backward()
                assert all(leaf.grad is not None and leaf.grad.isfinite().all() for leaf in leaves)


def test_gradient_is_continuous_through_touch() -> None:
    for gap in (1e-9, 0.0, -1e-9, 1e-4, -1e-4):
        pose = at(0.1 + gap, 0.01, 0.0).requires_grad_()
        signed_gap(cuboid(0.1, 0.1), cuboid(0.1, 0.1), pose).backward()
        np.testing.assert_allclose(pose.grad[:2], [1, 0], atol=1e-9)


def test_ties_do_not_depend_on_where_the_scene_stands() -> None:
    poses_world = torch.tensor(np.random.default_rng(6).uniform(-3, 3, (200, 3)))
    a, b = cuboid(0.1, 0.1), cuboid(0.1, 0.1)
    first = contact_between(a, b, at(0.12, 0.0))
    pose_a_from_b = relative(poses_world, compose(poses_world, at(0.12, 0.0).expand(200, 3)))
    many = RoundedBox(a.half_extents.expand(200, 2), a.radius.expand(200))
    moved = contact_between(many, many, pose_a_from_b)
    for one, all_of_them in zip(first, moved, strict=True):
        np.testing.assert_allclose(all_of_them, one.expand_as(all_of_them), atol=1e-9)


def test_float32_gap_far_from_the_origin_keeps_its_precision() -> None:
    a, b, pose_a_from_b = random_pairs(7, 2_000)
    far = torch.tensor([10.0, -10.0, 2.0], dtype=torch.float64).expand(2_000, 3)
    pose_b = compose(far, pose_a_from_b).float()
    single = signed_gap(
        RoundedBox(*(t.float() for t in a)), RoundedBox(*(t.float() for t in b)), relative(far.float(), pose_b)
    )
    np.testing.assert_allclose(single, signed_gap(a, b, pose_a_from_b), atol=1e-5)


def test_at_a_tie_both_functions_give_the_gradient_of_one_feature() -> None:
    for a, b, at_tie in (
        (cuboid(0.1, 0.1), cuboid(0.1, 0.1), at(0.099, 0.01)),
        (cylinder(0.04), cuboid(0.2, 0.1), at(0.02, 0.04)),
        (cuboid(0.2, 0.1), cylinder(0.04), at(0.02, 0.04)),
    ):
        gradients = []
        for gap in (signed_gap, lambda *pair: contact_between(*pair).gap):
            pose = at_tie.clone().requires_grad_()
            gap(a, b, pose).backward()
            gradients.append(pose.grad)
        np.testing.assert_allclose(gradients[0], gradients[1], atol=1e-12)


def test_the_gap_of_a_cylinder_inside_a_cuboid_does_not_depend_on_its_own_yaw() -> None:
    pose = at(0.02, 0.04).requires_grad_()
    signed_gap(cuboid(0.2, 0.1), cylinder(0.04), pose).backward()
    np.testing.assert_allclose(pose.grad, [0, 1, 0], atol=1e-12)


def test_second_contacts_lie_on_both_surfaces_across_from_each_other() -> None:
    a, b, pose = random_pairs(8, 20_000)
    result = contact_between(a, b, pose)
    parted = (result.gap > 0) & (a.half_extents.amin(-1) > 0) & (b.half_extents.amin(-1) > 0)
    origin_in_b = inverse(pose)
    on_a, on_b = result.points_a[parted, 1], transform(origin_in_b, result.points_b[:, 1])[parted]
    for half, points in ((a.half_extents[parted], on_a), (b.half_extents[parted], on_b)):
        outside = (points.abs() - half).amax(-1)
        np.testing.assert_allclose(outside, 0, atol=1e-9)
    length = torch.linalg.vector_norm(result.points_b[parted, 1] - result.points_a[parted, 1], dim=-1)
    np.testing.assert_allclose(length, result.gaps[parted, 1], atol=1e-9)


@pytest.mark.parametrize("gap", [0.0, -1e-3, 0.01])
def test_parallel_faces_meet_where_they_look_at_each_other_even_if_they_touch(gap: float) -> None:
    box = RoundedBox(torch.tensor([0.05, 0.05], dtype=torch.float64), torch.tensor(0.0, dtype=torch.float64))
    pose_a_from_b = torch.tensor([0.1 + gap, 0.04, 0.0], dtype=torch.float64)
    touch = contact_between(box, box, pose_a_from_b)
    torch.testing.assert_close(touch.points_a[:, 1].sort().values, torch.tensor([-0.01, 0.05], dtype=torch.float64))
    torch.testing.assert_close(touch.gaps, torch.full((2,), gap, dtype=torch.float64))
    torch.testing.assert_close(touch.middle, torch.tensor([0.05 + gap / 2, 0.02], dtype=torch.float64))


def test_numpy_in_gives_numpy_out_and_the_same_numbers() -> None:
    tensors = random_pairs(7, 1000)
    a, b = (RoundedBox(*(values.numpy() for values in box)) for box in tensors[:2])
    pose = tensors[2].numpy()
    for ours, theirs in zip(contact_between(a, b, pose), contact_between(*tensors), strict=True):
        assert isinstance(ours, np.ndarray)
        np.testing.assert_allclose(ours, theirs.numpy(), atol=1e-9)
    np.testing.assert_allclose(signed_gap(a, b, pose), signed_gap(*tensors).numpy(), atol=1e-12)
    np.testing.assert_allclose(contact_between(a, b, pose).middle, contact_between(*tensors).middle.numpy(), atol=1e-9)
    single = contact_between(*(RoundedBox(*(v.astype(np.float32) for v in box)) for box in (a, b)), pose.astype("f4"))
    assert {values.dtype for values in single} == {np.dtype(np.float32)}
    one = contact_between(*(RoundedBox(*(values[0] for values in box)) for box in (a, b)), pose[0])
    np.testing.assert_allclose(one.points_b, contact_between(a, b, pose).points_b[0], atol=1e-12)


def test_what_does_not_go_together_is_named() -> None:
    a, b, pose = random_pairs(7, 3)
    between = inspect.unwrap(contact_between)  # without the checks of shapes that tests put around it
    for first, at, says in (
        (RoundedBox(a.half_extents.numpy(), a.radius), pose, "a.half_extents: NumPy float64, but pose_a_from_b is t"),
        (a, pose.float(), "a.half_extents: torch float64, but pose_a_from_b is torch float32; all must be alike"),
        (RoundedBox(a.half_extents[:, :1], a.radius), pose, r"a.half_extents: shape must end with 2, got \(3, 1\)"),
        (a, pose[:, :2], r"pose_a_from_b: shape must end with 3, got \(3, 2\)"),
        (a, [0.0, 0.0, 0.0], "pose_a_from_b: must be an array of NumPy or torch, got list"),
    ):
        with pytest.raises(GeometryError, match=says):
            between(first, b, at)
