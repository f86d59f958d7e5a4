"""Many scenes as tensors: what does not change while they are pushed."""

import functools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple, TypeVar, cast

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch.nn import functional

from pushgraph import pose
from pushgraph.body import Joint
from pushgraph.contact import RoundedBox, contact_between, signed_gap
from pushgraph.graph.feet import BodyFeet, feet_of_shapes
from pushgraph.patch import BodyPatch, overlap_in_piece, patches_of_members
from pushgraph.scene import (
    NOMINAL_MASS,
    NOMINAL_SIDE_FRICTION,
    NOMINAL_TABLE_FRICTION,
    JointFrame,
    Scene,
    Table,
    place_joint,
)
from pushgraph.shape import rounded_boxes, simple
from pushgraph.simulation.feet import feet_of

JOINT_CODES = {"none": 0, "fixed": 1, "prismatic": 2, "revolute": 3}
"""The paper's codes of joints."""
FIXED_MASS = 1000.0
"""Stands for the mass of what cannot move (kg): the greatest that a scene may give."""
Index = int | Int[Tensor, "*batch"]
Batch = TypeVar("Batch")


class Relations(NamedTuple):
    """What is known of every pair of bodies a < b, in the order of `pairs_of`, and what is remembered of it.

    kind: JOINT_CODES, 0 where not known. anchor_a, anchor_b: the joint's anchor, or for an unknown pair the middle of
    where its bodies faced each other when it was first adjacent, in the frame of each body (m). yaw_offset: yaw of b
    less that of a then (rad). axis: along which b slides, in the frame of a. limits: lowest and highest angle of b
    relative to a (rad) or displacement along the axis (m). remembered: whether there is an
    anchor.
    """

    kind: Int[Tensor, "batch pairs"]
    known: Bool[Tensor, "batch pairs"]
    remembered: Bool[Tensor, "batch pairs"]
    anchor_a: Float[Tensor, "batch pairs 2"]
    anchor_b: Float[Tensor, "batch pairs 2"]
    yaw_offset: Float[Tensor, "batch pairs"]
    axis: Float[Tensor, "batch pairs 2"]
    limits: Float[Tensor, "batch pairs 2"]

    def take(self, index: Int[Tensor, " scenes"]) -> "Relations":
        """Those of some scenes, in the order of `index`."""
        return map_tensors(lambda values: values[index], self)


class SceneBatch(NamedTuple):
    """Scenes side by side, padded to the most bodies and tool parts among them.

    group: index of the first body of a body's rigid group; its own, if it is in none. Unknown masses and frictions
    stand at their nominal values, with the flag off; what cannot move has FIXED_MASS. feet: where bodies press on the
    table. centre_of_mass: in the body's frame (m). gyration: mean squared distance of a body's mass from there (m^2).
    tool_radius: distance of the tool's farthest point from its origin (m). anisotropy: of the table's friction, times
    cosine and sine of twice the direction of its grain in the world.
    """

    present: Bool[Tensor, "batch bodies"]
    boxes: RoundedBox  # [batch bodies]
    is_cylinder: Bool[Tensor, "batch bodies"]
    feet: BodyFeet  # [batch bodies feet]
    centre_of_mass: Float[Tensor, "batch bodies 2"]
    gyration: Float[Tensor, "batch bodies"]
    group: Int[Tensor, "batch bodies"]
    immovable: Bool[Tensor, "batch bodies"]
    mass: Float[Tensor, "batch bodies"]
    mass_known: Bool[Tensor, "batch bodies"]
    yaw_known: Bool[Tensor, "batch bodies"]
    table_friction: Float[Tensor, " batch"]
    table_friction_known: Bool[Tensor, " batch"]
    anisotropy: Float[Tensor, "batch 2"]
    side_friction: Float[Tensor, " batch"]
    side_friction_known: Bool[Tensor, " batch"]
    part_present: Bool[Tensor, "batch parts"]
    parts: RoundedBox  # [batch parts]
    pose_tool_from_part: Float[Tensor, "batch parts 3"]
    tool_radius: Float[Tensor, " batch"]
    relations: Relations

    def take(self, index: Int[Tensor, " scenes"]) -> "SceneBatch":
        """Some of the scenes, in the order of `index`; one that stands alone is not copied."""
        if len(self.present) == 1:
            return map_tensors(lambda values: values.expand(len(index), *values.shape[1:]), self)
        return map_tensors(lambda values: values[index], self)

    def to(self, device: torch.device | str) -> "SceneBatch":
        """The same on another device."""
        return map_tensors(lambda values: values.to(device), self)


@functools.cache
@torch.inference_mode(False)
def pairs_of(bodies: int, device: torch.device | str = "cpu") -> Int[Tensor, "2 pairs"]:
    """All pairs a < b of a number of bodies."""
    return torch.triu_indices(bodies, bodies, 1, device=device)


@functools.cache
@torch.inference_mode(False)
def pairs_with_parts(bodies: int, parts: int, device: torch.device | str = "cpu") -> Int[Tensor, "2 all_pairs"]:
    """The pairs of `pairs_of`, then every body with every part of the tool, which count on from the bodies."""
    first = torch.arange(bodies, device=device).repeat_interleave(parts)
    second = torch.arange(bodies, bodies + parts, device=device).repeat(bodies)
    return torch.cat((pairs_of(bodies, device), torch.stack((first, second))), 1)


def pair_index(a: Index, b: Index, bodies: int) -> Index:
    """Where the pair a < b stands in `pairs_of`."""
    return a * bodies - a * (a + 1) // 2 + b - a - 1


def batch_scenes(scenes: Sequence[Scene], patches: Sequence[Mapping[int, BodyPatch]] = ()) -> SceneBatch:
    """Stack scenes; bodies stand in their scene's order. There is room for two at least, so that there is a pair.

    patches: of each scene, how its bodies, by index, spread their weight and press, where their shapes do not tell.
    """
    count, bodies = len(scenes), max(2, *(len(scene.bodies) for scene in scenes))
    parts = max(len(scene.tool.parts) for scene in scenes)
    columns = {
        "present": np.zeros((count, bodies), bool),
        "core": np.zeros((count, bodies, 3), np.float32),
        "is_cylinder": np.zeros((count, bodies), bool),
        "group": np.tile(np.arange(bodies), (count, 1)),
        "immovable": np.zeros((count, bodies), bool),
        "mass": np.full((count, bodies), NOMINAL_MASS, np.float32),
        "mass_known": np.zeros((count, bodies), bool),
        "yaw_known": np.zeros((count, bodies), bool),
        "part_present": np.zeros((count, parts), bool),
        "part_core": np.zeros((count, parts, 3), np.float32),
        "pose_tool_from_part": np.zeros((count, parts, 3), np.float32),
    }
    for k, scene in enumerate(scenes):
        n = len(scene.bodies)
        columns["present"][k, :n] = True
        columns["core"][k, :n] = [simple(body.shape).core for body in scene.bodies]
        columns["is_cylinder"][k, :n] = [body.shape.kind == "cylinder" for body in scene.bodies]
        columns["mass"][k, :n] = [NOMINAL_MASS if body.mass is None else body.mass for body in scene.bodies]
        columns["mass_known"][k, :n] = [body.mass is not None for body in scene.bodies]
        still = columns["immovable"][k, :n] = scene.immovable
        columns["mass"][k, :n][still], columns["mass_known"][k, :n][still] = FIXED_MASS, True
        columns["yaw_known"][k, :n] = [body.yaw_known for body in scene.bodies]
        index = {name: i for i, name in enumerate(scene.names)}
        for group in scene.rigid_groups:
            members = [index[name] for name in group]
            columns["group"][k, members] = min(members)
        p = len(scene.tool.parts)
        columns["part_present"][k, :p] = True
        columns["part_core"][k, :p] = [part.shape.core for part in scene.tool.parts]
        columns["pose_tool_from_part"][k, :p] = [part.pose_tool_from_part for part in scene.tool.parts]
    tensors = {name: torch.from_numpy(values) for name, values in columns.items()}
    core, part_core = tensors.pop("core"), tensors.pop("part_core")
    table = [scene.table.friction for scene in scenes]
    side = [scene.side_friction for scene in scenes]
    boxes = RoundedBox(core[..., :2], core[..., 2])
    feet = feet_of_shapes(boxes, tensors["is_cylinder"])
    gyration = boxes.radius.square() / 2 + boxes.half_extents.square().sum(-1) / 3
    feet, centre_of_mass, gyration = _with_patches(scenes, feet, gyration, patches)
    return SceneBatch(
        boxes=boxes,
        feet=feet,
        centre_of_mass=centre_of_mass,
        gyration=gyration,
        parts=RoundedBox(part_core[..., :2], part_core[..., 2]),
        tool_radius=torch.tensor([scene.tool.reach for scene in scenes], dtype=torch.float32),
        table_friction=torch.tensor([NOMINAL_TABLE_FRICTION if f is None else f for f in table]),
        table_friction_known=torch.tensor([f is not None for f in table]),
        anisotropy=torch.tensor([_anisotropy(scene.table) for scene in scenes]),
        side_friction=torch.tensor([NOMINAL_SIDE_FRICTION if f is None else f for f in side]),
        side_friction_known=torch.tensor([f is not None for f in side]),
        relations=_relations(scenes, bodies),
        **tensors,
    )


def _anisotropy(table: Table) -> tuple[float, float]:
    """See SceneBatch."""
    return (
        table.anisotropy * math.cos(2 * table.grain_world),
        table.anisotropy * math.sin(2 * table.grain_world),
    )


def _with_patches(
    scenes: Sequence[Scene],
    feet: BodyFeet,
    gyration: Float[Tensor, "batch bodies"],
    given: Sequence[Mapping[int, BodyPatch]],
) -> tuple[BodyFeet, Float[Tensor, "batch bodies 2"], Float[Tensor, "batch bodies"]]:
    """Feet, centres of mass and moments: those of shapes and the origins, but of bodies with a support, that overlap in
    a rigid group, or whose patches are given, those of their own patches."""
    centre_of_mass = torch.zeros(*gyration.shape, 2)
    special: list[tuple[int, int, BodyPatch]] = []
    for k, scene in enumerate(scenes):
        index = {name: i for i, name in enumerate(scene.names)}
        pieces = [[index[name] for name in group] for group in scene.rigid_groups]
        grouped = {i for piece in pieces for i in piece}
        pieces += [[i] for i, body in enumerate(scene.bodies) if body.support is not None and i not in grouped]
        for piece in pieces:
            members = [scene.bodies[i] for i in piece]
            if any(body.support is not None for body in members) or overlap_in_piece(members):
                special += [(k, i, patch) for i, patch in zip(piece, patches_of_members(members), strict=True)]
    special += [(k, i, patch) for k, of_bodies in enumerate(given) for i, patch in of_bodies.items()]
    if not special:
        return feet, centre_of_mass, gyration
    found = [feet_of(patch.pressure) for _, _, patch in special]
    missing = max(len(own.weights) for own in found) - feet.shares.shape[-1]
    points = functional.pad(feet.points, (0, 0, 0, max(missing, 0)))
    shares, radii = (functional.pad(values, (0, max(missing, 0))) for values in feet[1:])
    for (k, body, patch), own in zip(special, found, strict=True):
        count = len(own.weights)
        points[k, body], shares[k, body], radii[k, body] = 0.0, 0.0, 0.0
        points[k, body, :count] = torch.from_numpy(own.points).float()
        shares[k, body, :count] = torch.from_numpy(own.weights).float()
        radii[k, body, :count] = torch.from_numpy(own.radii).float()
        centre_of_mass[k, body] = torch.from_numpy(patch.mass.centre).float()
        gyration[k, body] = float(np.trace(patch.mass.second_moments))
    return BodyFeet(points, shares, radii), centre_of_mass, gyration


def hide_relations(scenes: SceneBatch, hidden: Bool[Tensor, "batch pairs"]) -> SceneBatch:
    """The same scenes, some pairs unknown: neither joint nor anchor are given."""
    old = scenes.relations
    return scenes._replace(
        relations=old._replace(
            kind=torch.where(hidden, 0, old.kind),
            known=old.known & ~hidden,
            remembered=old.remembered & ~hidden,
            limits=torch.where(hidden[..., None], 0.0, old.limits),
        )
    )


def remember(
    scenes: SceneBatch,
    relations: Relations,
    poses: Float[Tensor, "batch bodies 3"],
    adjacent_gap: float,
    motions: Float[Tensor, "batch bodies 3"] | None = None,
) -> Relations:
    """Start the memory of unknown pairs that are adjacent for the first time.

    motions: of bodies since this was last asked, if it was; pairs that did not move are as far apart as they were.
    """
    if _all_known(relations.known):
        return relations
    a, b = ends = pairs_of(poses.shape[1], poses.device)
    # What is not there is infinitely far from everything.
    circle = scenes.boxes.half_extents.norm(dim=-1) + scenes.boxes.radius
    circle = torch.where(scenes.present, circle, -torch.inf)

    def of_ends(values: Tensor) -> tuple[Tensor, ...]:
        return values.index_select(1, ends.flatten()).unflatten(1, (2, -1)).unbind(1)

    (x_a, x_b), (circle_a, circle_b) = of_ends(poses[..., :2]), of_ends(circle)
    apart = (x_b - x_a).norm(dim=-1) - circle_a - circle_b
    new = (apart < adjacent_gap) & ~(relations.known | relations.remembered)
    if motions is not None:
        new &= torch.logical_or(*of_ends((motions != 0).any(-1)))
    scene, pair = new.nonzero(as_tuple=True)
    if not len(scene):
        return relations
    boxes = _boxes(scenes, scene, a[pair]), _boxes(scenes, scene, b[pair])
    close = signed_gap(*boxes, pose.relative(poses[scene, a[pair]], poses[scene, b[pair]]).float()) < adjacent_gap
    scene, pair = scene[close], pair[close]
    if not len(scene):
        return relations
    pose_a, pose_b = poses[scene, a[pair]], poses[scene, b[pair]]
    boxes = _boxes(scenes, scene, a[pair]), _boxes(scenes, scene, b[pair])
    touch = contact_between(*boxes, pose.relative(pose_a, pose_b).float())
    middle = touch.middle
    anchor_world = pose.transform(pose_a, middle.to(pose_a))
    anchor_b = pose.transform(pose.inverse(pose_b), anchor_world)

    def put(old: Tensor, values: Tensor) -> Tensor:
        return old.index_put((scene, pair), values.to(old.dtype))

    return relations._replace(
        remembered=put(relations.remembered, torch.ones_like(scene, dtype=torch.bool)),
        anchor_a=put(relations.anchor_a, middle),
        anchor_b=put(relations.anchor_b, anchor_b),
        yaw_offset=put(relations.yaw_offset, pose_b[:, 2] - pose_a[:, 2]),
    )


def _all_known(known: Bool[Tensor, "batch pairs"]) -> bool:
    """Whether every pair is known; asked once of the same tensor, step after step of a rollout."""
    global _last_known
    asked, answer = _last_known  # at once: other threads may come in between
    if asked is not known:
        answer = bool(known.all())
        _last_known = known, answer
    return answer


_last_known: tuple[Tensor | None, bool] = (None, False)


def _boxes(scenes: SceneBatch, scene: Tensor, body: Tensor) -> RoundedBox:
    """Of some bodies, in float32 whatever the scenes are in."""
    return RoundedBox(*(values[scene, body].float() for values in scenes.boxes))


def _relations(scenes: Sequence[Scene], bodies: int) -> Relations:
    count, pairs = len(scenes), bodies * (bodies - 1) // 2
    kind = np.zeros((count, pairs), np.int64)
    known = np.ones((count, pairs), bool)
    anchors = np.zeros((2, count, pairs, 2), np.float32)
    yaw_offset = np.zeros((count, pairs), np.float32)
    axis_in_a = np.zeros((count, pairs, 2), np.float32)
    all_limits = np.zeros((count, pairs, 2), np.float32)
    jointed: list[_Jointed] = []
    for k, scene in enumerate(scenes):
        if not scene.joints and not scene.unknown_pairs:
            continue
        index = {name: i for i, name in enumerate(scene.names)}
        if scene.unknown_pairs:
            known[k] = _known_pairs(scene, index, bodies)
        jointed += [_Jointed(k, index[joint.parent], index[joint.child], joint) for joint in scene.joints]
    for (k, parent, child, joint), (anchor, axis, limits) in zip(jointed, _joint_frames(scenes, jointed), strict=True):
        a, b = sorted((parent, child))
        pose_a, pose_b = (np.array(scenes[k].bodies[body].pose_world_from_body) for body in (a, b))
        pair = pair_index(a, b, bodies)
        kind[k, pair], known[k, pair] = JOINT_CODES[joint.kind], True
        for side, pose_body in enumerate((pose_a, pose_b)):
            anchors[side, k, pair] = pose.transform(pose.inverse(pose_body), anchor)
        yaw_offset[k, pair] = pose_b[2] - pose_a[2]
        # The motion of the later body relative to the earlier one.
        axis = axis if a == parent else -axis
        axis_in_a[k, pair] = pose.rotate(axis, -pose_a[2])
        limits_of_b = (-limits[1], -limits[0]) if a == child and joint.kind == "revolute" else limits
        all_limits[k, pair] = limits_of_b
    return Relations(
        kind=torch.from_numpy(kind),
        known=torch.from_numpy(known),
        remembered=torch.from_numpy(kind > 0),
        anchor_a=torch.from_numpy(anchors[0]),
        anchor_b=torch.from_numpy(anchors[1]),
        yaw_offset=torch.from_numpy(yaw_offset),
        axis=torch.from_numpy(axis_in_a),
        limits=torch.from_numpy(all_limits),
    )


class _Jointed(NamedTuple):
    scene: int
    parent: int
    child: int
    joint: Joint


def _joint_frames(scenes: Sequence[Scene], jointed: Sequence[_Jointed]) -> list[JointFrame]:
    """Frames of joints of many scenes, their contacts computed together."""
    if not jointed:
        return []
    ends = [[scenes[one.scene].bodies[getattr(one, end)] for one in jointed] for end in ("parent", "child")]
    poses = [np.array([body.pose_world_from_body for body in bodies]) for bodies in ends]
    parents, children = (rounded_boxes([simple(body.shape) for body in bodies]) for bodies in ends)
    touch = contact_between(parents, children, pose.relative(*poses))
    columns = zip(jointed, *poses, touch.gap.tolist(), touch.middle, strict=True)
    return [place_joint(one.joint, *place) for one, *place in columns]


def _known_pairs(scene: Scene, index: dict[str, int], bodies: int) -> np.ndarray:
    known = np.ones(bodies * (bodies - 1) // 2, bool)
    if scene.unknown_pairs == "unlisted":
        for a, b in scene.pairs_apart:
            known[pair_index(a, b, bodies)] = False
        return known
    for names in scene.unknown_pairs:
        a, b = sorted(index[name] for name in names)
        known[pair_index(a, b, bodies)] = False
    return known


def map_tensors(function: Callable[..., Tensor], *batches: Batch) -> Batch:
    """Apply a function to the tensors of nested batches that stand at the same place; what is none stays as it is."""
    first = batches[0]
    if isinstance(first, Tensor):
        return cast(Batch, function(*batches))
    if not isinstance(first, tuple):
        return first
    return type(first)(*[map_tensors(function, *values) for values in zip(*batches, strict=True)])


def double(batch: Batch) -> Batch:
    """The same in float64."""
    return map_tensors(lambda values: values.double() if values.is_floating_point() else values, batch)


def tensors_of(batch: tuple) -> Iterator[Tensor]:
    """All tensors of nested batches."""
    for values in batch:
        if isinstance(values, Tensor):
            yield values
        elif isinstance(values, tuple):
            yield from tensors_of(values)


def concatenate(batches: Sequence[Batch]) -> Batch:
    """One batch of several of the same kind and width."""
    return map_tensors(lambda *tensors: torch.cat(tensors), *batches)
