"""The compiled step of boards computes what the one in tensors computes."""

import numpy as np
import pytest
import torch

from pushgraph import pose_3d
from pushgraph.contact_patch import POINTS, contact_patch
from pushgraph.graph.lever_batch import LeverState, start_lever
from pushgraph.lever_physics import LeverPredictor, rollout_lever, tool_knots
from pushgraph.network import body_step
from pushgraph.network.compiled.box_contact import best_axis, edge_point, face_points
from pushgraph.network.lever_dynamics import LEVERS
from pushgraph.simulation.lever_setup import draw_scene


def drawn_states(count: int) -> tuple[LeverState, torch.Tensor]:
    """Drives with the tool somewhere on its way, boards displaced, turned and in motion; and the way of a step."""
    rng = np.random.default_rng(1)
    scenes = [draw_scene(1, k % 12) for k in range(count)]
    state = start_lever(scenes)
    twist = torch.from_numpy(rng.normal(size=(count, 6)) * [1e-3, 1e-3, 2e-3, 0.02, 0.02, 0.1])
    pose = pose_3d.compose(state.pose, pose_3d.exponential(twist))
    velocity = torch.from_numpy(rng.normal(size=(count, 6)) * 0.1)
    first = rng.integers(20, 100, size=count)
    ways = [tool_knots(scene, 60)[k : k + 2] for scene, k in zip(scenes, first, strict=True)]
    return LeverState(state.scenes, pose, velocity), torch.from_numpy(np.stack(ways))


def test_steps_are_those_in_tensors(monkeypatch: pytest.MonkeyPatch) -> None:
    state, way = drawn_states(48)
    wrench = torch.from_numpy(np.random.default_rng(0).normal(size=(48, 6)) * 0.1)
    compiled = body_step.step(state, way[:, 0], way[:, 1], 0.025, wrench)
    monkeypatch.setattr(body_step, "FEW", 1000)
    tensors = body_step.step(state, way[:, 0], way[:, 1], 0.025, wrench)
    touching = body_step.find_contacts(state.scenes, state.pose, state.velocity, way[:, 0], way[:, 1], 0.025)
    assert len(touching.scene.unique()) > 40
    torch.testing.assert_close(compiled.velocity, tensors.velocity, rtol=0, atol=1e-7)
    torch.testing.assert_close(compiled.pose, tensors.pose, rtol=0, atol=1e-8)


def test_boards_that_nothing_touches_stay_bit_for_bit() -> None:
    state = start_lever([draw_scene(1, k) for k in range(16)])
    away = torch.tensor([5.0, 0, 0, 1, 0, 0, 0], dtype=torch.float64).expand(16, 7)
    moved = body_step.step(state, away, away + 0.01 * torch.eye(7, dtype=torch.float64)[2], 0.025)
    assert torch.equal(moved.pose, state.pose)
    assert not moved.velocity.any()


def test_quaternions_stay_unit_and_poses_finite_over_300_frames() -> None:
    """The screwdriver stays where it ended."""
    scenes = [draw_scene(2, k) for k in range(32)]
    tool = torch.from_numpy(np.stack([tool_knots(scene, 300) for scene in scenes]))
    poses = rollout_lever(LeverPredictor.load().dynamics, start_lever(scenes), tool)
    assert poses.isfinite().all()
    assert float((poses[..., 3:].norm(dim=-1) - 1).abs().amax()) < 1e-6


@pytest.mark.slow
def test_a_thousand_rollouts_are_finite() -> None:
    """Tracks and predictors refuse what is not."""
    scenes = [draw_scene(3, k) for k in range(1000)]
    for kind in LEVERS.values():
        torch.manual_seed(0)
        tracks = LeverPredictor(kind(hidden=16).double().eval()).predict_many(scenes)
        lengths = [np.linalg.norm(track.board[:, 3:], axis=-1) for track in tracks]
        assert np.abs(np.concatenate(lengths) - 1).max() < 1e-6


def test_patches_of_boxes_are_those_in_tensors() -> None:
    rng = np.random.default_rng(2)
    kinds = set()
    for number in range(200):
        half_a, half_b = rng.uniform(0.01, 0.1, (2, 3))
        pose_a, pose_b = (pose_3d.normalized(np.concatenate((rng.normal(size=3) * 0.05, q))) for q in quaternions(rng))
        if number % 4 == 0:  # faces that lie flat on each other
            pose_b = np.concatenate((pose_a[:3], pose_a[3:]))
            pose_b[:3] += pose_3d.rotate(np.array([0.01, 0.005, half_a[2] + half_b[2] + 1e-4]), pose_a[3:])
        normal, points, gaps = np.empty(3), np.empty((POINTS, 3)), np.empty(POINTS)
        a, b = (
            (pose[:3].copy(), pose_3d.rotation_matrix(pose[3:]), half)
            for pose, half in ((pose_a, half_a), (pose_b, half_b))
        )
        best, gap = best_axis(*a, *b, 1.0, normal)
        kinds.add(min(best // 3, 2))
        count = 1
        if best < 3:
            count = face_points(*a, *b, normal, points, gaps)
        elif best < 6:
            count = face_points(*b, *a, -normal, points, gaps)
            points[:count] += gaps[:count, None] * normal
        else:
            edge_point(*a, *b, normal, best - 6, points[0])
            gaps[0] = gap
        found = contact_patch(*(torch.from_numpy(values) for values in (pose_a, half_a, pose_b, half_b)))
        np.testing.assert_allclose(normal, found.normal, atol=1e-9)
        there = found.touches.numpy()
        assert count == there.sum()
        expected = np.concatenate((found.point[there], found.gap[there, None]), -1)
        mine = np.concatenate((points[:count], gaps[:count, None]), -1)
        np.testing.assert_allclose(in_order(mine), in_order(expected), atol=1e-9)
    assert kinds == {0, 1, 2}


def quaternions(rng: np.random.Generator) -> np.ndarray:
    return rng.normal(size=(2, 4))


def in_order(rows: np.ndarray) -> np.ndarray:
    return rows[np.lexsort(rows.round(6).T)]
