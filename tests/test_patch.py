"""Pressure and mass of pieces, against values worked out by hand and by shapely."""

import math

import numpy as np
import pytest
import shapely
from exact_shapes import mean_radius
from scenes import body

from pushgraph import pose
from pushgraph.errors import SceneError
from pushgraph.patch import mass_properties, patch_of
from pushgraph.shape import Cuboid, Cylinder, Polygon

BAR = Cuboid(size=(0.2, 0.04))
DISC = Cylinder(diameter=0.1)
TRIANGLE = Polygon(points=((0, 0), (0.12, 0), (0, 0.09)))


@pytest.mark.parametrize("shape", [BAR, DISC, Cuboid(size=(0.1, 0.1))])
def test_a_single_body_is_exact(shape) -> None:
    one = body("a", 0.3, -0.2, shape, yaw=0.4, mass=2.0)
    patch, mass = patch_of([one]), mass_properties([one])
    half_x, half_y, radius = shape.core
    inertia = radius**2 / 2 if radius else (half_x**2 + half_y**2) / 3
    assert patch.weights.sum() == pytest.approx(1)
    assert patch.centre == pytest.approx([0.3, -0.2], abs=1e-9)
    assert np.trace(patch.second_moments) == pytest.approx(inertia, rel=1e-9)
    assert patch.mean_radius == pytest.approx(mean_radius(shape), rel=2e-3)
    assert mass.mass == 2
    assert mass.moment_of_inertia == pytest.approx(2 * inertia, rel=1e-9)
    assert 200 <= len(patch.weights) <= 400


@pytest.mark.parametrize("points", [TRIANGLE.points, TRIANGLE.points[::-1]])
def test_a_right_triangle_by_hand(points) -> None:
    patch = patch_of([body("a", 0, 0, Polygon(points=points))])
    assert patch.centre == pytest.approx([0.04, 0.03], abs=1e-9)
    moments = [[0.12**2 / 18, -0.12 * 0.09 / 36], [-0.12 * 0.09 / 36, 0.09**2 / 18]]
    assert patch.second_moments == pytest.approx(np.array(moments), rel=1e-6)


def test_an_l_by_parallel_axes() -> None:
    points = ((0, 0), (0.1, 0), (0.1, 0.02), (0.02, 0.02), (0.02, 0.08), (0, 0.08))
    mass = mass_properties([body("a", 0, 0, Polygon(points=points), mass=1.0)])
    areas = np.array([0.1 * 0.02, 0.02 * 0.06])
    centres = np.array([[0.05, 0.01], [0.01, 0.05]])
    centre = areas @ centres / areas.sum()
    own = np.array([0.1**2 + 0.02**2, 0.02**2 + 0.06**2]) / 12
    inertia = areas @ (own + ((centres - centre) ** 2).sum(1)) / areas.sum()
    assert mass.centre_of_mass == pytest.approx(centre, abs=1e-9)
    assert mass.moment_of_inertia == pytest.approx(inertia, rel=1e-6)


def test_a_polygon_presses_as_the_shape_that_it_draws() -> None:
    points = [(x * 0.1, y * 0.02) for x, y in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
    drawn, bar = (patch_of([body("a", 0.1, 0, shape, 0.3)]) for shape in (Polygon(points=points), BAR))
    assert drawn.centre == pytest.approx(bar.centre, abs=1e-9)
    assert drawn.second_moments == pytest.approx(bar.second_moments, rel=1e-6)
    assert drawn.mean_radius == pytest.approx(bar.mean_radius, rel=5e-3)


def test_ten_cells_are_one_bar() -> None:
    cells = [body(f"{k}", 0.02 * k - 0.09, 0, Cuboid(size=(0.02, 0.04)), mass=0.1) for k in range(10)]
    bar = [body("bar", 0, 0, BAR, mass=1.0)]
    assert patch_of(cells).centre == pytest.approx([0, 0], abs=1e-9)
    assert patch_of(cells).second_moments == pytest.approx(patch_of(bar).second_moments, rel=1e-9, abs=1e-12)
    assert patch_of(cells).mean_radius == pytest.approx(patch_of(bar).mean_radius, rel=2e-3)
    assert mass_properties(cells).moment_of_inertia == pytest.approx(mass_properties(bar).moment_of_inertia)
    assert len(patch_of(cells).weights) <= 1500


def test_copies_of_a_disc_are_one_disc() -> None:
    copies = [body(f"{k}", 0.1, 0.2, DISC, yaw=0.3 * k, mass=0.2 + k) for k in range(3)]
    assert patch_of(copies).centre == pytest.approx([0.1, 0.2], abs=1e-6)
    assert np.trace(patch_of(copies).second_moments) == pytest.approx(0.05**2 / 2, rel=1e-3)
    assert patch_of(copies).mean_radius == pytest.approx(0.1 / 3, rel=5e-3)


def test_a_cross_of_equal_bars_is_uniform_on_its_union() -> None:
    cross = [body("a", 0, 0, BAR, 0.0), body("b", 0, 0, BAR, math.pi / 2)]
    patch = patch_of(cross)
    union = shapely.union(shapely.box(-0.1, -0.02, 0.1, 0.02), shapely.box(-0.02, -0.1, 0.02, 0.1))
    step = np.arange(-0.1 + 2.5e-4, 0.1, 5e-4)
    grid = np.stack(np.meshgrid(step, step), -1).reshape(-1, 2)
    grid = grid[shapely.contains_xy(union, *grid.T)]
    assert patch.centre == pytest.approx([0, 0], abs=1e-6)
    assert np.trace(patch.second_moments) == pytest.approx((grid**2).sum(1).mean(), rel=1e-3)
    assert patch.mean_radius == pytest.approx(np.hypot(*grid.T).mean(), rel=5e-3)


def test_overlapping_bodies_of_unlike_mass_by_a_fine_grid() -> None:
    bodies = [body("a", 0, 0, BAR, 0.2, 1.0), body("b", 0.07, 0.01, DISC, 0, 3.0), body("c", 0.1, 0.03, BAR, 1.3, 0.5)]
    outlines = [
        shapely.affinity.translate(
            shapely.affinity.rotate(shapely.box(-0.1, -0.02, 0.1, 0.02), yaw, (0, 0), True), x, y
        )
        for x, y, yaw in ((0, 0, 0.2), (0.1, 0.03, 1.3))
    ]
    outlines.insert(1, shapely.Point(0.07, 0.01).buffer(0.05, 128))
    step = np.arange(-0.15, 0.25, 4e-4)
    grid = np.stack(np.meshgrid(step, step), -1).reshape(-1, 2)
    inside = np.stack([shapely.contains_xy(one, *grid.T) for one in outlines], -1)
    grid, inside = grid[inside.any(1)], inside[inside.any(1)]
    share = inside / inside.sum(1, keepdims=True)
    weights = (share / share.sum(0)) @ np.array([1.0, 3.0, 0.5]) / 4.5
    centre = weights @ grid
    patch, mass = patch_of(bodies), mass_properties(bodies)
    assert patch.centre == pytest.approx(centre, abs=1e-4)
    assert mass.centre_of_mass == pytest.approx(centre, abs=1e-4)
    moments = ((grid - centre) * weights[:, None]).T @ (grid - centre)
    assert patch.second_moments == pytest.approx(moments, rel=0.01, abs=1e-6)
    assert patch.mean_radius == pytest.approx(weights @ np.hypot(*(grid - centre).T), rel=5e-3)


def test_a_moved_piece_presses_as_before() -> None:
    motion = np.array([3.0, -2.0, 1.1])
    piece = [body("a", 0, 0, BAR, 0.2), body("b", 0.07, 0.01, DISC), body("c", 0.2, 0.1, TRIANGLE)]
    places = [tuple(pose.compose(motion, np.array(one.pose_world_from_body)).tolist()) for one in piece]
    moved = [one.replace(pose_world_from_body=place) for one, place in zip(piece, places, strict=True)]
    before, after = patch_of(piece), patch_of(moved)
    assert after.centre == pytest.approx(pose.transform(motion, before.centre), abs=1e-6)
    assert after.mean_radius == pytest.approx(before.mean_radius, rel=1e-3)
    assert mass_properties(moved).moment_of_inertia == pytest.approx(mass_properties(piece).moment_of_inertia, rel=1e-4)


def test_a_body_stands_on_its_feet() -> None:
    feet = ((-0.05, -0.01), (0.05, -0.01), (0.05, 0.01), (-0.05, 0.01))
    one = body("a", 1, 0, BAR, math.pi / 2).replace(support=feet)
    patch = patch_of([one])
    assert patch.weights == pytest.approx(np.full(4, 0.25))
    assert patch.centre == pytest.approx([1, 0], abs=1e-9)
    assert patch.points[0] == pytest.approx([1.01, -0.05])
    assert mass_properties([one]).moment_of_inertia == pytest.approx(0.5 * (0.2**2 + 0.04**2) / 12)


def test_loads_are_never_negative_and_balance() -> None:
    feet = ((-0.01, 0), (0.01, 0.001), (0.01, -0.001), (0.09, 0.02), (0.09, -0.02))
    one = body("a", 0, 0, BAR).replace(support=feet)
    patch = patch_of([one])
    assert (patch.weights >= 0).all()
    assert patch.centre == pytest.approx([0, 0], abs=1e-9)


def test_feet_that_cannot_carry_a_body_are_named() -> None:
    one = body("stool", 0, 0, BAR).replace(support=((0.05, 0), (0.06, 0.01), (0.06, -0.01)))
    with pytest.raises(SceneError, match=r"body 'stool': support: its centre of mass lies 50.0 mm outside"):
        patch_of([one])


def test_an_unknown_mass_is_named() -> None:
    with pytest.raises(SceneError, match="body 'a': mass: unknown"):
        patch_of([body("a", 0, 0, mass=None)])
