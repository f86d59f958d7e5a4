"""Scenes that are watched: one observed frame after the other, as the memory of pairs needs them.

What the tool cannot reach rests, so its pose is the mean of what was seen of it since it came to rest: noise of a
camera averages out, and so does that of the anchors of pairs that have not been touched yet.
"""

from collections.abc import Callable
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from pushgraph import pose
from pushgraph.graph.broad_phase import reachable
from pushgraph.graph.camera_noise import FINEST, CameraNoise
from pushgraph.graph.joint_fit import JointFits, RelativeMotion
from pushgraph.graph.scene_batch import Relations, SceneBatch, pairs_of
from pushgraph.graph.state import Control, State, start

COASTING = 2
"""Frames in which a body may still move after nothing reaches it any more."""
LONGEST_REST = 64.0
"""Places that are means of more frames count as means of so many: longer pauses change nothing."""
STRAY = 0.005
"""A body this far from where it rests (m) has moved, whatever the tool's pose says."""


InReach = Callable[[State, Control], Bool[Tensor, "batch bodies"]]


class View(NamedTuple):
    """The last frame seen.

    tool: pose_world_from_tool. tool_motion: how it changed in the frame before. first: where bodies were first seen.
    adjacent_at_first: pairs that were adjacent in the first frame. A body out of sight stays where it was last seen.
    unreached: frames since a body could last be reached. rested: frames that its pose is the mean of. untouched: bodies
    that have rested since the first frame. moving: bodies whose last motion is the difference of two sightings. fits:
    of the joints of all pairs, to what was seen so far. noise: of the camera.
    """

    state: State
    tool: Float[Tensor, "batch 3"]
    tool_motion: Float[Tensor, "batch 3"]
    down: Bool[Tensor, " batch"]
    seen: Bool[Tensor, "batch bodies"]
    ever_seen: Bool[Tensor, "batch bodies"]
    first: Float[Tensor, "batch bodies 3"]
    adjacent_at_first: Bool[Tensor, "batch pairs"]
    unreached: Int[Tensor, "batch bodies"]
    rested: Float[Tensor, "batch bodies"]
    untouched: Bool[Tensor, "batch bodies"]
    moving: Bool[Tensor, "batch bodies"]
    relative: RelativeMotion
    fits: JointFits
    noise: CameraNoise


class Frame(NamedTuple):
    """What one frame showed.

    in_sight: pairs both of whose bodies were seen. continuous: bodies seen in it and in the frame before.
    relative_before, relative: how pairs have moved relative to each other until the frame before, and this one. fits:
    of joints to what was seen before this frame. noise: of the camera. moved: pairs of which a body may have moved.
    resting: frames that the relative pose of a pair is the mean of.
    """

    before: State
    after: State
    control: Control
    first: Float[Tensor, "batch bodies 3"]
    adjacent_at_first: Bool[Tensor, "batch pairs"]
    in_sight: Bool[Tensor, "batch pairs"]
    continuous: Bool[Tensor, "batch bodies"]
    relative_before: RelativeMotion
    relative: RelativeMotion
    fits: JointFits
    noise: CameraNoise
    moved: Bool[Tensor, "batch pairs"]
    resting: Float[Tensor, "batch pairs"]


def first_look(
    scenes: SceneBatch,
    poses: Float[Tensor, "batch bodies 3"],
    tool: Float[Tensor, "batch 3"],
    down: Bool[Tensor, " batch"],
    seen: Bool[Tensor, "batch bodies"],
    camera_error: float = FINEST,
) -> tuple[View, Frame]:
    """Watch scenes from here on. Bodies that are not seen are taken to be at their `poses` until they are.

    camera_error: errors of poses that are expected beside noise (m), of turns at LEVER.
    """
    state = start(scenes, poses)._replace(still=STRAY)
    still = torch.zeros_like(tool)
    adjacent = state.relations.remembered & ~state.relations.known
    unreached = torch.full_like(seen, COASTING, dtype=torch.int64)
    rested = torch.ones_like(seen, dtype=poses.dtype)
    relative, fits = RelativeMotion.of(state.relations, poses), JointFits.begin(adjacent)
    noise = CameraNoise.begin(poses, camera_error)
    view = View(
        *(state, tool, still, down, seen, seen, poses, adjacent, unreached, rested, seen, torch.zeros_like(seen)),
        *(relative, fits, noise),
    )
    control = Control(tool, still, still, torch.zeros_like(down))
    in_sight, moved, resting = _both(seen), torch.zeros_like(adjacent), torch.ones_like(fits.frames)
    return view, Frame(
        state, state, control, poses, adjacent, in_sight, seen, relative, relative, fits, noise, moved, resting
    )


def look(
    view: View,
    poses: Float[Tensor, "batch bodies 3"],
    tool: Float[Tensor, "batch 3"],
    down: Bool[Tensor, " batch"],
    seen: Bool[Tensor, "batch bodies"],
    in_reach: InReach = lambda state, control: reachable(state, control).may_move,
) -> tuple[View, Frame]:
    """The next frame; poses of bodies that are not seen are not looked at. in_reach: finds what may move in a step."""
    both = down & view.down
    motion = torch.where(both[:, None], tool - view.tool, 0.0)
    control = Control(view.tool, motion, view.tool_motion, both)
    continuous = seen & view.seen

    last = view.state.poses
    unreached = torch.where(in_reach(view.state, control), 0, view.unreached + 1)
    away = poses - last
    strays = away[..., :2].square().sum(-1) > STRAY**2
    rests = continuous & (unreached > COASTING) & ~strays
    scenes = view.state.scenes
    noise = view.noise.observe_rest(away, view.rested * (rests & scenes.present), scenes.yaw_known)
    bends, moves = away - view.state.motions, continuous & ~rests & scenes.present & view.moving
    noise = noise.observe_bends(bends, moves, scenes.yaw_known)
    rested = torch.where(rests, view.rested + 1, torch.where(seen, 1.0, view.rested))
    poses = torch.where(rests[..., None], last + away / rested[..., None], poses)
    poses = torch.where(seen[..., None], poses, last)
    untouched = view.untouched & (rests | ~seen)
    first = torch.where((view.ever_seen & ~untouched)[..., None], view.first, poses)

    before = view.state
    if (away != 0)[rests].any():
        before = before._replace(relations=_settled(before.relations, poses, _both(untouched)))
    after = before.observe(poses)
    after = after._replace(motions=torch.where(continuous[..., None], after.motions, 0.0))
    in_sight = _both(seen)
    relative = RelativeMotion.of(after.relations, poses)
    moved = in_sight & ~_both(rests)
    fitted = moved & before.relations.remembered & ~before.relations.known
    a, b = pairs_of(seen.shape[1], seen.device)
    resting = (2 / (1 / rested[:, a] + 1 / rested[:, b]).double()).clamp(max=LONGEST_REST)
    begins = _both(untouched) | ~before.relations.remembered
    fits = view.fits._replace(rested=torch.where(begins, resting, view.fits.rested))
    frame = Frame(
        before,
        after,
        control,
        first,
        view.adjacent_at_first,
        in_sight,
        continuous,
        view.relative,
        relative,
        fits,
        noise,
        moved,
        resting,
    )
    view = View(
        after,
        tool,
        motion,
        down,
        seen,
        seen | view.ever_seen,
        first,
        view.adjacent_at_first,
        unreached,
        rested,
        untouched,
        continuous & ~rests,
        relative,
        fits.observe(relative, fitted) if fitted.any() else fits,
        noise,
    )
    return view, frame


def _settled(relations: Relations, poses: Tensor, untouched: Tensor) -> Relations:
    """Relations whose unknown pairs, as long as both rest, count their drift from where they now are known to stand."""
    a, b = pairs_of(poses.shape[1], poses.device)
    now = untouched & relations.remembered & ~relations.known
    if not now.any():
        return relations
    anchor_b = pose.transform(
        pose.inverse(poses[:, b]), pose.transform(poses[:, a], relations.anchor_a.to(poses.dtype))
    )
    offset = poses[:, b, 2] - poses[:, a, 2]
    return relations._replace(
        anchor_b=torch.where(now[..., None], anchor_b.to(relations.anchor_b.dtype), relations.anchor_b),
        yaw_offset=torch.where(now, offset.to(relations.yaw_offset.dtype), relations.yaw_offset),
    )


def _both(seen: Tensor) -> Tensor:
    a, b = pairs_of(seen.shape[1], seen.device)
    return seen[:, a] & seen[:, b]
