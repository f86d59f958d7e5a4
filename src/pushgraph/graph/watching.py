"""Scenes that are watched: one observed frame after the other, as the memory of pairs needs them."""

from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from pushgraph.graph.scene_batch import SceneBatch, pairs_of
from pushgraph.graph.state import Control, State, start


class View(NamedTuple):
    """The last frame seen.

    tool: pose_world_from_tool. tool_motion: how it changed in the frame before. first: where bodies were first seen.
    adjacent_at_first: pairs that were adjacent in the first frame. A body out of sight stays where it was last seen.
    """

    state: State
    tool: Float[Tensor, "batch 3"]
    tool_motion: Float[Tensor, "batch 3"]
    down: Bool[Tensor, " batch"]
    seen: Bool[Tensor, "batch bodies"]
    ever_seen: Bool[Tensor, "batch bodies"]
    first: Float[Tensor, "batch bodies 3"]
    adjacent_at_first: Bool[Tensor, "batch pairs"]


class Frame(NamedTuple):
    """What one frame showed.

    in_sight: pairs both of whose bodies were seen. continuous: bodies seen in it and in the frame before.
    """

    before: State
    after: State
    control: Control
    first: Float[Tensor, "batch bodies 3"]
    adjacent_at_first: Bool[Tensor, "batch pairs"]
    in_sight: Bool[Tensor, "batch pairs"]
    continuous: Bool[Tensor, "batch bodies"]


def first_look(
    scenes: SceneBatch,
    poses: Float[Tensor, "batch bodies 3"],
    tool: Float[Tensor, "batch 3"],
    down: Bool[Tensor, " batch"],
    seen: Bool[Tensor, "batch bodies"],
) -> tuple[View, Frame]:
    """Watch scenes from here on. Bodies that are not seen are taken to be at their `poses` until they are."""
    state = start(scenes, poses)
    still = torch.zeros_like(tool)
    adjacent = state.relations.remembered & ~state.relations.known
    view = View(state, tool, still, down, seen, seen, poses, adjacent)
    control = Control(tool, still, still, torch.zeros_like(down))
    return view, Frame(state, state, control, poses, adjacent, _both(seen), seen)


def look(
    view: View,
    poses: Float[Tensor, "batch bodies 3"],
    tool: Float[Tensor, "batch 3"],
    down: Bool[Tensor, " batch"],
    seen: Bool[Tensor, "batch bodies"],
) -> tuple[View, Frame]:
    """The next frame; poses of bodies that are not seen are not looked at."""
    poses = torch.where(seen[..., None], poses, view.state.poses)
    continuous = seen & view.seen
    after = view.state.observe(poses)
    after = after._replace(motions=torch.where(continuous[..., None], after.motions, 0.0))
    first = torch.where(view.ever_seen[..., None], view.first, poses)
    both = down & view.down
    motion = torch.where(both[:, None], tool - view.tool, 0.0)
    control = Control(view.tool, motion, view.tool_motion, both)
    frame = Frame(view.state, after, control, first, view.adjacent_at_first, _both(seen), continuous)
    return View(after, tool, motion, down, seen, seen | view.ever_seen, first, view.adjacent_at_first), frame


def _both(seen: Tensor) -> Tensor:
    a, b = pairs_of(seen.shape[1], seen.device)
    return seen[:, a] & seen[:, b]
