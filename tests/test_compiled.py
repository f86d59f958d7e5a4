"""The compiled solve computes what the tensors do: the same contacts, motions and states of contacts."""

from collections.abc import Sequence

import numpy as np
import pytest
import torch
from predictors import no_correction
from scenes import workshop

from pushgraph.contact import RoundedBox, contact_between
from pushgraph.graph.broad_phase import reachable
from pushgraph.graph.scene_batch import map_tensors
from pushgraph.graph.state import Control, State
from pushgraph.graph.steps import plan_steps
from pushgraph.network.compiled import arrays
from pushgraph.network.compiled.contact import contact_of
from pushgraph.network.compiled.in_reach import bodies_in_reach
from pushgraph.network.compiled.links import links_of
from pushgraph.network.compiled.step import solve_step
from pushgraph.network.dynamics import ContactDynamics, Foresight
from pushgraph.scene import Scene
from pushgraph.simulation.motion import plan_tool
from pushgraph.simulation.setups import draw_trajectory


@pytest.fixture(scope="module")
def scenes() -> list[Scene]:
    """Workshops, and scenes of many kinds, pushed once; some on tables with a grain."""
    drawn = [draw_trajectory("planar", 9, 6, k).track.scene for k in range(11)]
    grained = [s.replace(table=s.table.replace(anisotropy=0.3, grain=0.5 * k)) for k, s in enumerate(drawn[:4])]
    return [scene.replace(pushes=scene.pushes[:1]) for scene in [workshop(), *grained, *drawn[4:]]]


def steps_of(scenes: Sequence[Scene]) -> tuple[State, list[Control]]:
    """The state at the start, and what the tool does."""
    state = no_correction().start(scenes)
    plans = [plan_tool(scene.pushes, scene.tool)[0] for scene in scenes]
    longest = max(map(len, plans))
    tool = torch.tensor(np.stack([np.pad(plan, ((0, longest - len(plan)), (0, 0)), mode="edge") for plan in plans]))
    down = torch.ones(tool.shape[:2], dtype=torch.bool)
    return state, plan_steps(tool, down, state.scenes.tool_radius).controls


def one_of(state: State, control: Control, k: int) -> tuple[State, Control]:
    still = state.still
    state, control = (map_tensors(lambda values: values[k : k + 1], each) for each in (state, control))
    return state._replace(still=still), control


def by_tensors(state: State, control: Control) -> Foresight:
    """Foresight of each scene by itself, without compiled code."""
    dynamics = ContactDynamics().eval().requires_grad_(False)
    dynamics._can_be_compiled = lambda *_: False
    each = [dynamics.foresee(*one_of(state, control, k)) for k in range(len(state.poses))]
    return map_tensors(lambda *values: torch.cat(values), *each)


def test_contacts_of_two_shapes() -> None:
    rng = np.random.default_rng(0)
    count = 4000

    def shapes() -> tuple[np.ndarray, np.ndarray]:
        half, round_ = rng.uniform(0.01, 0.05, (count, 2)), rng.random(count) < 0.4
        radius = np.where(round_, half[:, 0], 0.0)
        return np.where(round_[:, None], 0.0, half), radius

    (half_a, radius_a), (half_b, radius_b) = shapes(), shapes()
    poses = np.column_stack((rng.uniform(-0.1, 0.1, (count, 2)), rng.uniform(-4, 4, count)))
    parallel = rng.random(count) < 0.3
    poses[parallel, 2] = rng.choice([0, np.pi / 2, np.pi, -np.pi / 2], parallel.sum())
    poses[:20, :2] = 0.0
    tensors = [torch.from_numpy(values) for values in (half_a, radius_a, half_b, radius_b, poses)]
    touch = contact_between(RoundedBox(*tensors[:2]), RoundedBox(*tensors[2:4]), tensors[4])
    rows = zip(half_a, radius_a, half_b, radius_b, poses, strict=True)
    found = np.array([contact_of(*a, radius_1, *b, radius_2, *place) for a, radius_1, b, radius_2, place in rows])
    columns = [touch.normal]
    for k in range(2):
        columns += [touch.gaps[:, k : k + 1], touch.points_a[:, k], touch.points_b[:, k]]
    np.testing.assert_allclose(found, torch.cat(columns, 1).numpy(), atol=1e-12)


@torch.no_grad()
def test_motions_and_states_of_contacts(scenes) -> None:
    state, controls = steps_of(scenes)
    dynamics = ContactDynamics().eval().requires_grad_(False)
    moved = linked = 0
    for control in controls[:30]:
        compiled, tensors = dynamics.foresee(state, control), by_tensors(state, control)
        np.testing.assert_allclose(compiled.motion, tensors.motion, atol=1e-8)
        np.testing.assert_array_equal(compiled.linked, tensors.linked)
        np.testing.assert_allclose(compiled.latents, tensors.latents, atol=1e-4)
        moved += int((compiled.motion.abs() > 1e-4).any(-1).sum())
        linked += int(compiled.linked.sum())
        state = state.observe(state.poses + compiled.motion, control.frames)
    assert moved > 150
    assert linked > 500


@torch.no_grad()
@pytest.mark.parametrize("limit", [0.3, *(pytest.param(limit, marks=pytest.mark.slow) for limit in (3.0, 30.0))])
def test_tools_with_a_force_limit(limit: float, scenes, monkeypatch) -> None:
    """Solved to rounding, but for the few steps in which iterations end before that."""
    monkeypatch.setattr("pushgraph.network.newton.CONVERGED", 1e-9)
    state, controls = steps_of(scenes)
    tensors = ContactDynamics().eval().requires_grad_(False)
    tensors._can_be_compiled = lambda *_: False
    dynamics = ContactDynamics().eval().requires_grad_(False)
    held_back = moved = 0
    apart = []
    for control in controls[:24]:
        limited = control._replace(force_limit=torch.full_like(control.pose[:, 0], limit))
        compiled = dynamics(state, limited)
        each = [tensors(*one_of(state, limited, k)) for k in range(len(scenes))]
        motion, done = (torch.cat(values) for values in zip(*each, strict=True))
        apart.append(torch.maximum((compiled.motion - motion).abs().amax((1, 2)), (compiled.done - done).abs()))
        held_back += int((done < 0.5).sum())
        moved += int((motion.abs() > 1e-4).any(-1).sum())
        state = state.observe(state.poses + compiled.motion, control.frames)
    assert held_back > 20 if limit < 1 else moved > 50
    differences = torch.stack(apart)
    assert (differences < 1e-5).double().mean() > 0.98
    assert differences.median() < 1e-9


def test_unknown_pairs_are_linked_alike(scenes) -> None:
    hidden = [scene.replace(joints=(), unknown_pairs="unlisted") for scene in scenes if not scene.rigid_groups]
    state, controls = steps_of(hidden)
    with torch.no_grad():
        compiled = ContactDynamics().eval().requires_grad_(False).foresee(state, controls[3])
    np.testing.assert_array_equal(compiled.linked, by_tensors(state, controls[3]).linked)
    assert compiled.linked.any()


def test_what_may_move(scenes) -> None:
    """Sliding bodies, chains, pieces and what cannot move."""
    state, controls = steps_of(scenes)
    unknown = state._replace(relations=state.relations._replace(known=torch.zeros_like(state.relations.known)))
    generator = torch.Generator().manual_seed(0)
    reached = 0
    for known in (state, unknown):
        for control in controls[:: max(1, len(controls) // 8)]:
            slides = torch.rand(known.poses.shape[:2], generator=generator) < 0.1
            motions = 0.01 * torch.randn(known.poses.shape, generator=generator, dtype=torch.float64)
            moving = known._replace(motions=torch.where(slides[..., None], motions, 0.0))
            found = bodies_in_reach(moving, control)
            assert torch.equal(found, reachable(moving, control).may_move)
            reached += int(found.sum())
    assert reached > 20


def test_scenes_do_not_depend_on_their_neighbours_nor_on_threads(scenes, monkeypatch) -> None:
    state, controls = steps_of(scenes)
    for control in controls[:12]:
        together = solve_step(state, control).motion
        state = state.observe(state.poses + torch.from_numpy(together))
    control = controls[12]
    together = solve_step(state, control).motion
    assert np.abs(together).max() > 1e-3
    alone = [solve_step(*one_of(state, control, k)).motion[0] for k in range(len(scenes))]
    np.testing.assert_array_equal(together, np.stack(alone))
    monkeypatch.setattr("pushgraph.network.compiled.threads.SHARE", 4)
    monkeypatch.setattr("torch.get_num_threads", lambda: 3)
    np.testing.assert_array_equal(together, solve_step(state, control).motion)


def test_what_wants_a_gradient_is_left_to_tensors(scenes) -> None:
    state, controls = steps_of(scenes[:1])
    motion = controls[5].motion.clone().requires_grad_()
    dynamics = ContactDynamics().eval().requires_grad_(False)
    assert dynamics(state, controls[5]._replace(motion=motion)).motion.requires_grad
    assert not dynamics(state, controls[5]).motion.requires_grad


def test_links_are_found_once_in_a_rollout(scenes, monkeypatch) -> None:
    """Looking at all pairs of many bodies in every step would take longer than the steps."""
    found = []
    monkeypatch.setattr(arrays, "links_of", lambda *given: found.append(1) or links_of(*given))
    state, controls = steps_of(scenes)
    for control in controls[:4]:
        solve_step(state, control)
        state = state.observe(state.poses, control.frames)
    assert found == [1]
    joined = state.relations._replace(kind=torch.ones_like(state.relations.kind))
    solve_step(state._replace(relations=joined), controls[0])
    assert found == [1, 1]
