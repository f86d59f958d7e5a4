"""Laws that predictions keep by construction: with corrections that were drawn as well as without any."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
import torch
from predictors import drawn_correction, no_correction
from scenes import body, flat_tool, mirrored, moved_by

from pushgraph.body import Body, Joint
from pushgraph.contact import signed_gap
from pushgraph.graph.contact_features import contact_features
from pushgraph.graph.contact_graph import contact_graph
from pushgraph.graph.state import Control, State
from pushgraph.network.contact_problem import SLIP, ContactProblem
from pushgraph.network.newton import solve, solve_positive
from pushgraph.physics import PhysicsPredictor
from pushgraph.pose import relative
from pushgraph.scene import Scene, Table
from pushgraph.shape import Cuboid, Cylinder, rounded_boxes
from pushgraph.simulation.planar import simulate
from pushgraph.simulation.setups import draw_trajectory
from pushgraph.tool import Push, Tool
from pushgraph.track import Track


@pytest.fixture(scope="module")
def laws() -> PhysicsPredictor:
    return no_correction()


@pytest.fixture(scope="module")
def drawn() -> PhysicsPredictor:
    return drawn_correction()


def crowd() -> Scene:
    """A hinged pair, a slider, loose bodies and a wall."""
    return Scene(
        bodies=(
            body("plate", 0.0, 0.0, Cuboid(size=(0.14, 0.10)), yaw=0.1),
            body("lid", 0.01, 0.11, Cuboid(size=(0.14, 0.10)), yaw=0.1, mass=0.3),
            body("cup", 0.16, 0.03),
            body("drawer", 0.32, 0.02, Cuboid(size=(0.12, 0.05)), yaw=-0.2),
            Body(name="wall", shape=Cuboid(size=(0.02, 0.5)), pose_world_from_body=(0.52, 0.0, 0.0), fixed=True),
        ),
        joints=(
            Joint(kind="revolute", parent="plate", child="lid", anchor=(0.06, 0.0525)),
            Joint(kind="prismatic", parent="cup", child="drawer", axis=(1.0, 0.1), limits=(-0.02, 0.05)),
        ),
        pushes=(Push(start=(-0.2, 0.02), end=(0.1, 0.05)),),
    )


def start_of(scene: Scene, tool=(-0.13, 0.02, 0.0), motion=(0.012, 0.001, 0.02)) -> tuple[State, Control]:
    """The scene at rest, and a first step of the tool."""
    state = no_correction().start([scene])
    still = torch.zeros(1, 3, dtype=torch.float64)
    rows = [torch.tensor([row], dtype=torch.float64) for row in (tool, motion)]
    return state, Control(*rows, still, torch.tensor([True]))


def overlap(track: Track, bodies: Sequence[int]) -> float:
    """How deep neighbours of a row lie in each other at most, in any frame (m)."""
    boxes = rounded_boxes([track.scene.bodies[k].shape for k in bodies])
    gaps = []
    for poses in track.poses[:, 1:]:
        a, b = (poses[bodies[s]] for s in (slice(None, -1), slice(1, None)))
        ends = [type(boxes)(boxes.half_extents[s], boxes.radius[s]) for s in (slice(None, -1), slice(1, None))]
        gaps.append(signed_gap(*ends, relative(a, b)).min())
    return -float(min(gaps))


@pytest.mark.parametrize(("force_limit", "anisotropy"), [(math.inf, 0.0), (2.0, 0.0), (2.0, 0.4)])
def test_the_gradient_of_the_energy_is_that_of_finite_differences(force_limit: float, anisotropy: float) -> None:
    """Friction is held meanwhile, and twists are far from where a contact closes."""
    state, control = start_of(crowd().replace(table=Table(anisotropy=anisotropy, grain=0.6)))
    graph = contact_graph(state, control._replace(force_limit=torch.tensor([force_limit])))
    assert len(graph.drives.node) == (force_limit < math.inf)
    problem = ContactProblem.of(graph)
    generator = torch.Generator().manual_seed(0)
    twist = 0.5 * torch.randn(3, len(graph.nodes.mass), generator=generator, dtype=torch.float64)
    # Near the plan the drive's force still rises with the lag.
    driven = graph.drives.node
    twist[:, driven] = problem.last[:, driven] + SLIP * twist[:, driven]
    moment = problem.linearize(twist, SLIP, 1.0)
    linearized = moment.linearized()
    direction = torch.randn(twist.shape, generator=generator, dtype=torch.float64)
    small = 1e-6
    ends = []
    for sign in (1, -1):
        at = problem.linearize(twist + sign * small * direction, SLIP, 1.0)
        at.hold(moment.pressing)
        ends.append(at.linearized().gradient)
    measured = (ends[0] - ends[1]) / (2 * small)
    own, (xx, xy, yy, xt, yt, tt) = direction, linearized.own
    expected = torch.stack(
        (
            xx * own[0] + xy * own[1] + xt * own[2],
            xy * own[0] + yy * own[1] + yt * own[2],
            xt * own[0] + yt * own[1] + tt * own[2],
        )
    )
    between = linearized.between.view(3, 3, -1)
    for k, (first, second) in enumerate(zip(problem.points.first, problem.points.second, strict=True)):
        expected[:, first] += between[..., k] @ direction[:, second]
        expected[:, second] += between[..., k].t() @ direction[:, first]
    torch.testing.assert_close(measured, expected, rtol=1e-5, atol=1e-5)


def test_the_slope_along_a_direction_is_the_gradient_times_it() -> None:
    graph = contact_graph(*start_of(crowd()))
    problem = ContactProblem.of(graph)
    generator = torch.Generator().manual_seed(1)
    twist, direction = torch.randn(2, 3, len(graph.nodes.mass), generator=generator, dtype=torch.float64)
    moment = problem.linearize(twist, SLIP, 1.0)
    alone = [torch.zeros_like(rows) for rows in (problem.feet.node, problem.scene, problem.points.first)]
    for length in (0.0, 0.3):
        at = problem.linearize(twist + length * direction, SLIP, 1.0)
        at.hold(moment.pressing)
        expected = float((at.linearized().gradient * direction).sum())
        slope = moment.slope(direction).at(torch.tensor([length], dtype=torch.float64), *alone)
        assert float(slope) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("corrected", [False, True])
def test_forces_of_pairs_are_equal_and_opposite(corrected: bool, drawn) -> None:
    """What acts between nodes adds up to nothing over all nodes, tools and walls included."""
    state, control = start_of(crowd())
    graph = contact_graph(state, control)
    network = drawn.dynamics.network
    correction = network(graph, contact_features(state, graph)) if corrected else None
    generator = torch.Generator().manual_seed(2)
    twist = torch.randn(3, len(graph.nodes.mass), generator=generator, dtype=torch.float64)
    whole = ContactProblem.of(graph, correction)
    assert bool(whole.force.any()) == corrected
    without = whole._replace(
        inertia=torch.zeros_like(whole.inertia), feet=whole.feet._replace(weight=torch.zeros_like(whole.feet.weight))
    )
    forces = without.linearize(twist, SLIP, 1.0).linearized().gradient
    assert float(forces.abs().max()) > 0.1
    assert float(forces[:2].sum(1).abs().max()) < 1e-9 * float(forces.abs().max())


@pytest.mark.parametrize("systems", [3, 60])
def test_positive_systems_are_solved_however_many_there_are(systems: int) -> None:
    generator = torch.Generator().manual_seed(0)
    root = torch.randn(systems, 7, 7, generator=generator, dtype=torch.float64)
    matrix = root @ root.mT + torch.eye(7, dtype=torch.float64)
    right = torch.randn(systems, 7, generator=generator, dtype=torch.float64)
    expected = torch.linalg.solve(matrix, right)
    found = solve_positive(matrix.permute(1, 2, 0).contiguous(), right.t().contiguous())
    torch.testing.assert_close(found.t(), expected)


def test_forces_balance_in_the_solution(monkeypatch) -> None:
    monkeypatch.setattr("pushgraph.network.newton.CONVERGED", 1e-9)
    monkeypatch.setattr("pushgraph.network.newton.ITERATIONS", 200)
    graph = contact_graph(*start_of(crowd()))
    problem = ContactProblem.of(graph)
    twist = solve(problem)
    gradient = problem.linearize(twist, SLIP, 1.0).linearized().gradient
    assert float(gradient[:, ~graph.nodes.given].abs().max()) < 1e-6
    assert float(twist[:, ~graph.nodes.given].abs().max()) > 0.1


@pytest.mark.parametrize("kind", ["laws", "drawn"])
@pytest.mark.parametrize("index", [0, 3])
def test_mirror_images_have_mirrored_answers(kind: str, index: int, request) -> None:
    predictor = request.getfixturevalue(kind)
    scene = draw_trajectory("multiple-parts", 6, 11, index).track.scene
    scene = scene.replace(pushes=scene.pushes[:1])
    scenes = [scene.replace(table=scene.table.replace(size=(20, 20))) for scene in (scene, mirrored(scene))]
    there, here = (predictor.predict_many([one], 51)[0].poses for one in scenes)
    assert np.abs(there[-1, 1:] - there[0, 1:]).max() > 0.01
    # Corrections are computed in float32.
    np.testing.assert_allclose(here * [1, -1, -1], there, atol=1e-7 if kind == "laws" else 1e-4, rtol=0)


@pytest.mark.parametrize("copies", [2, 5, 16])
@pytest.mark.parametrize("kind", ["laws", "drawn"])
def test_copies_of_a_disc_are_one_disc(kind: str, copies: int, request) -> None:
    predictor = request.getfixturevalue(kind)

    def pushed(count: int) -> np.ndarray:
        discs = tuple(body(f"{k}", 0.0, 0.0, Cylinder(diameter=0.1), mass=1.0 / count) for k in range(count))
        groups = (tuple(disc.name for disc in discs),) if count > 1 else ()
        push = Push(start=(-0.12, 0.02), end=(0.0, 0.02))
        other = body("other", 0.12, 0.0, Cuboid(size=(0.08, 0.08)))
        return predictor.predict(Scene(bodies=(*discs, other), rigid_groups=groups, pushes=(push,))).poses[-1]

    one, many = pushed(1), pushed(copies)
    # Corrections are computed in float32.
    np.testing.assert_allclose(many[[1, -1]], one[[1, -1]], atol=1e-7 if kind == "laws" else 1e-5, rtol=0)


@pytest.mark.parametrize("count", [3, 6, 15, 20])
def test_a_row_of_boxes_moves_as_one_and_none_lies_in_another(count: int, laws) -> None:
    boxes = tuple(
        body(f"{k}", 0.0505 * k, 0.0, Cuboid(size=(0.05, 0.05)), mass=0.2 + 0.1 * (k % 3)) for k in range(count)
    )
    push = Push(start=(-0.055, 0.0), end=(0.045, 0.0), speed=0.1)
    scene = Scene(bodies=boxes, tool=flat_tool(0.02, 0.06), table=Table(size=(4.0, 4.0)), pushes=(push,))
    track = laws.predict(scene)
    stroke = 100 - (0.055 - 0.025 - 0.01) * 1e3
    expected = stroke - 0.5 * np.arange(count)
    np.testing.assert_allclose(moved_by(track)[:, 0], expected, atol=1.0)
    np.testing.assert_allclose(moved_by(track)[:, 1:], 0, atol=0.01)
    assert overlap(track, range(count)) < 0.5e-3


@pytest.mark.parametrize("kind", ["laws", "drawn"])
def test_joints_stop_at_their_limits(kind: str, request) -> None:
    """A lid swings to its limit and takes its plate with it; a drawer slides to its end and does the same."""
    predictor = request.getfixturevalue(kind)
    hinged = Scene(
        bodies=(body("plate", 0.0, 0.0, Cuboid(size=(0.1, 0.1))), body("lid", 0.0, 0.11, Cuboid(size=(0.1, 0.1)))),
        joints=(Joint(kind="revolute", parent="plate", child="lid", anchor=(0.05, 0.055), limits=(-0.3, 0.3)),),
        pushes=(Push(start=(-0.12, 0.14), end=(0.1, 0.14)),),
    )
    track = predictor.predict(hinged)
    turned = track.poses[:, 2, 2] - track.poses[:, 1, 2]
    assert turned.min() < -0.29
    assert turned.min() > -0.3 - math.radians(0.1)
    sliding = hinged.replace(
        joints=(Joint(kind="prismatic", parent="plate", child="lid", axis=(1.0, 0.0), limits=(-0.01, 0.05)),)
    )
    track = predictor.predict(sliding)
    seen = relative(track.poses[:, 1], track.poses[:, 2])
    assert seen[:, 0].max() > 0.049
    assert seen[:, 0].max() < 0.0501
    assert np.abs(seen[:, 1] - 0.11).max() < 1e-4
    assert np.abs(seen[:, 2]).max() < math.radians(0.1)


def test_fixed_bodies_stand_and_nothing_goes_through_them(laws) -> None:
    track = laws.predict(crowd())
    assert (track.poses[:, 5] == track.poses[0, 5]).all()
    wall, drawer = track.poses[-1, 5], track.poses[-1, 4]
    boxes = [rounded_boxes([track.scene.bodies[k].shape]) for k in (3, 4)]
    (gap,) = signed_gap(*boxes, relative(drawer, wall)[None])
    assert gap > -0.5e-3


@pytest.mark.parametrize("friction", [0.05, 0.2, 1.0, 2.0])
def test_a_puck_that_is_let_go_slides_as_far_as_coulomb_says(friction: float, laws) -> None:
    """The tool stops within one frame: after that the puck slides v^2 / (2 mu g).

    What is let go at once counts as let go half a frame, 10 mm, earlier.
    """
    puck = body("puck", 0.0, 0.0, Cylinder(diameter=0.06))
    push = Push(start=(-0.085, 0.0), path=[(0.115, 0.0), (0.11, 0.0)], times=[0.5, 0.55], rest=3.0)
    scene = Scene(bodies=(puck,), table=Table(size=(6, 6), friction=friction), pushes=(push,), tool=Tool.round(0.1))
    predicted, simulated = (moved_by(track)[0, 0] for track in (laws.predict(scene), simulate(scene)))
    assert predicted == pytest.approx(simulated, abs=10.5)


@pytest.mark.parametrize("frames_per_step", [2, 4])
def test_longer_steps_end_where_short_ones_do(frames_per_step: int, laws) -> None:
    box = body("box", 0.0, 0.0, Cuboid(size=(0.1, 0.08)), yaw=0.2)
    scene = Scene(bodies=(box,), pushes=(Push(start=(-0.15, 0.01), end=(0.1, 0.0), speed=0.1),))
    short, long = (laws.predict_many([scene], frames_per_step=n)[0].poses for n in (1, frames_per_step))
    assert len(short) == len(long)
    assert np.abs(short[-1, 1] - short[0, 1]).max() > 0.05
    np.testing.assert_allclose(long[-1, 1, :2], short[-1, 1, :2], atol=2.5e-3 * frames_per_step)
    np.testing.assert_allclose(long[:, 1, :2], short[:, 1, :2], atol=2.5e-3 * frames_per_step)


def test_a_frame_in_which_the_tool_goes_far_is_cut(laws) -> None:
    """A thin plate stays before a tool that goes 5 cm in a frame."""
    plate = body("plate", 0.0, 0.0, Cuboid(size=(0.004, 0.1)))
    push = Push(start=(-0.33, 0.0), path=[(0.1, 0.0)], times=[0.43], rest=0.05)
    scene = Scene(bodies=(plate,), tool=flat_tool(0.01, 0.1), pushes=(push,), table=Table(size=(4, 4)))
    track = laws.predict(scene)
    assert (track.poses[:, 1, 0] > track.poses[:, 0, 0]).all()
    assert moved_by(track)[0, 0] > 90
