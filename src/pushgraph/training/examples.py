"""Training examples: windows of a dataset with their scenes, some knowledge withheld, half of them mirrored."""

from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn import functional

from pushgraph import pose
from pushgraph.dataset.store import Dataset
from pushgraph.dataset.windows import WindowBatch
from pushgraph.graph.scene_batch import (
    JOINT_CODES,
    Relations,
    SceneBatch,
    batch_scenes,
    hide_relations,
    pairs_of,
    remember,
)
from pushgraph.graph.state import ADJACENT, Control, State, controls
from pushgraph.scene import NOMINAL_MASS, NOMINAL_SIDE_FRICTION, NOMINAL_TABLE_FRICTION
from pushgraph.training.share import Draws

FARTHEST = 0.025
"""Windows in which the tool moves farther than this in a step (m) do not count."""
WITHHELD = 0.15
"""Share of scenes in which one kind of knowledge (joints, masses, frictions, yaws) is withheld, each by itself."""


class Example(NamedTuple):
    """A batch of windows ready for prediction: the state to start from, what the tool does in each step, and what
    happened. counts: windows in which the tool does not move too far in a step. noise: in standard deviations, for what
    a network is told in each step of how bodies moved."""

    state: State
    controls: list[Control]
    poses: Float[Tensor, "batch knots bodies 3"]
    counts: Bool[Tensor, " batch"]
    noise: Float[Tensor, "batch steps bodies 3"]


class ExampleMaker:
    """Makes examples from the windows of one dataset, whose scenes it keeps as tensors."""

    def __init__(self, dataset: Dataset, device: torch.device | str = "cpu") -> None:
        self._device = device
        self._scenes = batch_scenes([dataset.scene(k) for k in range(len(dataset))]).to(device)

    def __call__(self, windows: WindowBatch, draws: Draws, frames_per_step: int = 1) -> Example:
        """The first frame of a window only tells the motion at its second, where prediction starts.

        At the start of a push everything rests: there the window's first frame stands for both.
        """
        device = self._device
        scenes = self._scenes.take(torch.from_numpy(windows.trajectory).to(device))
        missing = 1 + scenes.mass.shape[1] - windows.poses.shape[2]
        poses = functional.pad(torch.from_numpy(windows.poses).to(device), (0, 0, 0, missing))
        initial = functional.pad(torch.from_numpy(windows.initial_poses).to(device), (0, 0, 0, missing))[:, 1:]
        sign = draws.signs().to(device)
        scenes, poses, initial = mirror_scenes(scenes, sign), mirror(poses, sign), mirror(initial, sign)
        rests = torch.from_numpy(windows.push_start).to(device)[:, None, None, None]
        poses = torch.where(rests, torch.cat((poses[:, :1], poses[:, :-1]), 1), poses)
        tool, bodies = poses[:, :, 0], poses[:, :, 1:]
        scenes = withhold(scenes, bodies[:, 1], draws)
        relations = remember(scenes, scenes.relations, initial, ADJACENT)
        relations = remember(scenes, relations, bodies[:, 1], ADJACENT)
        state = State(scenes, bodies[:, 1], bodies[:, 1] - bodies[:, 0], relations)
        frames_per_step = min(frames_per_step, tool.shape[1] - 2)
        knots = torch.arange(1, tool.shape[1], frames_per_step, device=device)
        # The first step tells the pace of the frame before, and is not predicted.
        at_knots = torch.cat((tool[:, :1], tool[:, knots]), 1)
        lasting = torch.full_like(at_knots[:, 1:, 0], float(frames_per_step))
        lasting[:, 0] = 1.0
        steps = controls(at_knots, torch.ones_like(at_knots[..., 0], dtype=torch.bool), lasting)[1:]
        motion = tool[:, knots].diff(dim=1)
        travel = motion[..., :2].norm(dim=-1) + motion[..., 2].abs() * scenes.tool_radius[:, None]
        noise = draws.normal(len(steps), *bodies.shape[2:]).to(bodies)
        return Example(state, steps, bodies[:, knots], travel.amax(1) <= FARTHEST, noise)


def mirror(poses: Float[Tensor, "batch *nodes 3"], sign: Float[Tensor, " batch"]) -> Float[Tensor, "batch *nodes 3"]:
    """Poses seen in a mirror along the x-axis where the sign is -1."""
    sign = sign.view(-1, *[1] * (poses.dim() - 2))
    return torch.stack((poses[..., 0], poses[..., 1] * sign, poses[..., 2] * sign), -1)


def mirror_scenes(scenes: SceneBatch, sign: Float[Tensor, " batch"]) -> SceneBatch:
    """Scenes whose tools, feet and joints are seen in the same mirror; shapes are symmetric."""

    def points(values: Tensor) -> Tensor:
        of_scene = sign.view(-1, *[1] * (values.dim() - 2))
        return torch.stack((values[..., 0], values[..., 1] * of_scene), -1)

    old = scenes.relations
    swapped = (old.kind == JOINT_CODES["revolute"])[..., None] & (sign < 0)[:, None, None]
    return scenes._replace(
        pose_tool_from_part=mirror(scenes.pose_tool_from_part, sign),
        feet=scenes.feet._replace(points=points(scenes.feet.points)),
        centre_of_mass=points(scenes.centre_of_mass),
        anisotropy=points(scenes.anisotropy),
        relations=old._replace(
            anchor_a=points(old.anchor_a),
            anchor_b=points(old.anchor_b),
            yaw_offset=old.yaw_offset * sign[:, None],
            axis=points(old.axis),
            limits=torch.where(swapped, -old.limits.flip(-1), old.limits),
        ),
    )


def withhold(scenes: SceneBatch, poses: Float[Tensor, "batch bodies 3"], draws: Draws) -> SceneBatch:
    """Withhold some knowledge, so that the networks learn to do without it.

    Of a scene's joints, or its masses, either all or each with an even chance.
    """
    bodies = poses.shape[1]

    def drawn_share(*shape: int) -> Bool[Tensor, "..."]:
        one = [1] * len(shape)
        chosen, all_of_it = draws.uniform(*one) < WITHHELD, draws.uniform(*one) < 0.5
        drawn = chosen & (all_of_it | (draws.uniform(*shape) < 0.5))
        return drawn.to(poses.device)

    scenes = hide_relations(scenes, drawn_share(scenes.relations.kind.shape[1]))
    no_mass, no_table, no_side = drawn_share(bodies), drawn_share(), drawn_share()
    no_yaw = drawn_share(bodies) & scenes.is_cylinder
    return scenes._replace(
        mass=torch.where(no_mass, NOMINAL_MASS, scenes.mass),
        mass_known=scenes.mass_known & ~no_mass,
        table_friction=torch.where(no_table, NOMINAL_TABLE_FRICTION, scenes.table_friction),
        table_friction_known=scenes.table_friction_known & ~no_table,
        side_friction=torch.where(no_side, NOMINAL_SIDE_FRICTION, scenes.side_friction),
        side_friction_known=scenes.side_friction_known & ~no_side,
        yaw_known=scenes.yaw_known & ~no_yaw,
        relations=_without_yaw(scenes.relations, poses, no_yaw),
    )


def _without_yaw(relations: Relations, poses: Tensor, no_yaw: Tensor) -> Relations:
    """Joints of bodies whose turning was not seen count from where they are now."""
    a, b = pairs_of(poses.shape[1], poses.device)
    blind_a, blind_b = no_yaw[:, a], no_yaw[:, b]
    pose_a, pose_b = poses[:, a], poses[:, b]
    anchor_from_a = pose.transform(pose_a, relations.anchor_a)
    anchor_from_b = pose.transform(pose_b, relations.anchor_b)
    anchor = torch.where(blind_a[..., None], anchor_from_b, anchor_from_a)
    return relations._replace(
        anchor_a=torch.where(blind_a[..., None], pose.transform(pose.inverse(pose_a), anchor), relations.anchor_a),
        anchor_b=torch.where(blind_b[..., None], pose.transform(pose.inverse(pose_b), anchor), relations.anchor_b),
        yaw_offset=torch.where(blind_a | blind_b, pose_b[..., 2] - pose_a[..., 2], relations.yaw_offset),
    )
