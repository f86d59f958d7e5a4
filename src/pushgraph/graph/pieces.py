"""Pieces: bodies that move as one, in a rigid group or known to be joined by fixed joints."""

from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from pushgraph import pose
from pushgraph.graph.scene_batch import JOINT_CODES, Relations, SceneBatch, pairs_of


class Pieces(NamedTuple):
    """Pieces of each scene, each standing at the index of its first body; the other rows hold nothing.

    index: the piece of each body. centre: centre of mass, world (m). gyration: mean squared distance of its mass from
    there (m^2). immovable: whether it holds a body that cannot move.
    """

    index: Int[Tensor, "batch bodies"]  # type: ignore[assignment]  # a tuple's own `index` is of no use here
    mass: Float[Tensor, "batch bodies"]
    centre: Float[Tensor, "batch bodies 2"]
    gyration: Float[Tensor, "batch bodies"]
    immovable: Bool[Tensor, "batch bodies"]


def piece_index(scenes: SceneBatch, relations: Relations) -> Int[Tensor, "batch bodies"]:
    """For each body the first body of its piece."""
    index = scenes.group
    a, b = pairs_of(index.shape[1], index.device)
    scene, pair = (relations.kind == JOINT_CODES["fixed"]).nonzero(as_tuple=True)
    if not len(scene):
        return index
    bodies = index.shape[1]
    flat = index.reshape(-1)
    first, second = scene * bodies + a[pair], scene * bodies + b[pair]
    group = torch.arange(len(flat), device=flat.device) // bodies * bodies + flat
    while True:
        # The smaller label of the two ends goes to both; a body then takes over its first body's label.
        smaller = torch.minimum(flat[first], flat[second])
        new = flat.scatter_reduce(0, first, smaller, "amin").scatter_reduce(0, second, smaller, "amin")
        new = new.scatter_reduce(0, group, new, "amin")
        new = torch.minimum(new, new[group])
        if torch.equal(new, flat):
            return flat.view_as(index)
        flat = new


def all_loose(index: Int[Tensor, "batch bodies"]) -> bool:
    """Whether every body is a piece by itself, so that there is nothing to sum up."""
    return torch.equal(index, torch.arange(index.shape[1], device=index.device).expand_as(index))


def gather_pieces(
    scenes: SceneBatch, index: Int[Tensor, "batch bodies"], poses: Float[Tensor, "batch bodies 3"]
) -> Pieces:
    """Mass, centre and extent of the pieces, bodies being at `poses`."""
    weight = scenes.mass * scenes.present
    centres = poses[..., :2]
    if bool((scenes.centre_of_mass != 0).any()):
        centres = centres + pose.rotate(scenes.centre_of_mass.to(poses.dtype), poses[..., 2])
    if all_loose(index):
        return Pieces(index, weight, centres, scenes.gyration, scenes.immovable)
    planar = index[..., None].expand(centres.shape)
    mass = torch.zeros_like(weight).scatter_add(1, index, weight)
    share = weight / mass.gather(1, index).clamp(min=1e-9)
    # Summed as offsets from the piece's first body, so that nothing is lost far from the origin.
    first = centres.gather(1, planar)
    offset = torch.zeros_like(centres).scatter_add(1, planar, (centres - first) * share[..., None])
    centre = centres + offset
    distance = (centres - centre.gather(1, planar)).to(weight.dtype)
    gyration = torch.zeros_like(weight).scatter_add(
        1, index, (distance.square().sum(-1) + scenes.gyration) * share
    )
    immovable = torch.zeros_like(index).scatter_reduce(1, index, scenes.immovable.long(), "amax") > 0
    return Pieces(index, mass, centre, gyration, immovable)


def move_pieces(
    pieces: Pieces,
    poses: Float[Tensor, "batch bodies 3"],
    twist: Float[Tensor, "batch bodies 3"],
) -> Float[Tensor, "batch bodies 3"]:
    """How each body's pose changes if its piece's centre moves by twist[..., :2] (m) and it turns by twist[..., 2]."""
    if all_loose(pieces.index):
        return twist
    index = pieces.index[..., None]
    twist = twist.gather(1, index.expand(twist.shape))
    arm = poses[..., :2] - pieces.centre.gather(1, index.expand(poses[..., :2].shape))
    sin, versine = twist[..., 2].sin(), 2 * (twist[..., 2] / 2).sin().square()
    swing = torch.stack((-arm[..., 1] * sin - arm[..., 0] * versine, arm[..., 0] * sin - arm[..., 1] * versine), -1)
    return torch.cat((twist[..., :2] + swing, twist[..., 2:]), -1)


def mean_motion(
    scenes: SceneBatch, index: Int[Tensor, "batch bodies"], motions: Float[Tensor, "batch bodies 3"]
) -> Float[Tensor, "batch bodies 3"]:
    """How the centres of the pieces move and turn, given how their bodies do: the mean over mass."""
    if all_loose(index):
        return motions
    weight = (scenes.mass * scenes.present)[..., None]
    rows = index[..., None].expand(motions.shape)
    total = torch.zeros_like(motions).scatter_add(1, rows, motions * weight)
    return total / torch.zeros_like(weight).scatter_add(1, rows[..., :1], weight).clamp(min=1e-9)
