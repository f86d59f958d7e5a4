"""Scenes in space as tensors: one board each, and the boxes around it, of the tool or fixed."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from pushgraph import pose_3d
from pushgraph.lever_scene import Box, LeverScene, ToolBox


class LeverBatch(NamedTuple):
    """What does not change while boards move. Boxes are all but the board, filled up with absent ones.

    half: half sizes (m). pose: of fixed boxes in the world, of the tool's in its frame. friction: between a box and the
    board. inertia: of the board about its own axes (kg m2). gravity: m/s2.
    """

    board_half: Float[Tensor, "batch 3"]
    mass: Float[Tensor, " batch"]
    inertia: Float[Tensor, "batch 3"]
    gravity: Float[Tensor, "batch 3"]
    half: Float[Tensor, "batch boxes 3"]
    pose: Float[Tensor, "batch boxes 7"]
    friction: Float[Tensor, "batch boxes"]
    of_tool: Bool[Tensor, "batch boxes"]
    present: Bool[Tensor, "batch boxes"]

    def take(self, index: Tensor) -> "LeverBatch":
        """Some of the scenes."""
        return LeverBatch(*(values[index] for values in self))

    def boxes_with(self, tool: Float[Tensor, "batch 7"]) -> Float[Tensor, "batch boxes 7"]:
        """pose_world_from_box where pose_world_from_tool is `tool`."""
        moved = pose_3d.compose(tool[:, None], self.pose)
        return torch.where(self.of_tool[..., None], moved, self.pose)


class LeverState(NamedTuple):
    """Boards in motion. pose: pose_world_from_board. velocity: of the centre (m/s) and turning (rad/s), world axes."""

    scenes: LeverBatch
    pose: Float[Tensor, "batch 7"]
    velocity: Float[Tensor, "batch 6"]


def batch_lever_scenes(scenes: Sequence[LeverScene]) -> LeverBatch:
    """Stack scenes."""
    widest = max(len(scene.bodies) - 1 + len(scene.tool.boxes) for scene in scenes)
    return LeverBatch(*(torch.stack(column) for column in zip(*(_tensors(s, widest) for s in scenes), strict=True)))


def start_lever(scenes: Sequence[LeverScene]) -> LeverState:
    """Boards at rest where their scenes say."""
    poses = torch.from_numpy(np.stack([scene.bodies[scene.board].pose for scene in scenes]))
    return LeverState(batch_lever_scenes(scenes), poses, poses.new_zeros(len(scenes), 6))


def displacement(before: Float[Tensor, "batch 7"], after: Float[Tensor, "batch 7"]) -> Float[Tensor, "batch 6"]:
    """What leads from one pose to another: displacement of the origin (m), rotation vector, world axes."""
    turn = pose_3d.rotation_vector(pose_3d.multiply(after[:, 3:], pose_3d.conjugate(before[:, 3:])))
    return torch.cat((after[:, :3] - before[:, :3], turn), -1)


def _tensors(scene: LeverScene, width: int) -> LeverBatch:
    board = scene.bodies[scene.board]
    half = np.array(board.size) / 2
    boxes: list[tuple[Box | ToolBox, float, bool]] = [
        (body, body.friction, False) for body in scene.bodies if body.fixed
    ]
    boxes += [(box, scene.tool.friction, True) for box in scene.tool.boxes]
    spare = width - len(boxes)
    absent = np.array([0, 0, 0, 1.0, 0, 0, 0])
    squares = half**2
    return LeverBatch(
        board_half=torch.from_numpy(half),
        mass=torch.tensor(board.mass, dtype=torch.float64),
        inertia=torch.from_numpy(board.mass / 3 * (squares.sum() - squares)),
        gravity=torch.tensor(scene.gravity, dtype=torch.float64),
        half=torch.from_numpy(np.stack([*(np.array(box.size) / 2 for box, _, _ in boxes), *[np.ones(3)] * spare])),
        pose=torch.from_numpy(np.stack([*(box.pose for box, _, _ in boxes), *[absent] * spare])),
        friction=torch.tensor([max(f, board.friction) for _, f, _ in boxes] + [0.0] * spare, dtype=torch.float64),
        of_tool=torch.tensor([of_tool for _, _, of_tool in boxes] + [False] * spare),
        present=torch.arange(width) < len(boxes),
    )
