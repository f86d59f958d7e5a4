"""What is truly joined, as it is scored, and which pairs could show it."""

import math

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from pushgraph.graph.pieces import piece_index
from pushgraph.graph.scene_batch import JOINT_CODES, SceneBatch, hide_relations, pairs_of
from pushgraph.graph.state import start
from pushgraph.scene import NOMINAL_MASS

SHIFTED = 0.02
"""An adjacent pair is touched once either of its bodies has moved this far (m)."""
PARALLEL = math.radians(1.0)
"""Sides are parallel up to this angle (rad)."""


def true_joints(scenes: SceneBatch) -> Int[Tensor, "batch pairs"]:
    """JOINT_CODES of all pairs, closed."""
    return closed(scenes, scenes.relations.kind)


def closed(scenes: SceneBatch, kind: Int[Tensor, "batch pairs"]) -> Int[Tensor, "batch pairs"]:
    """Joints of all pairs; no motion can tell what holds a rigid piece together, so all in it is fixed."""
    piece = piece_index(scenes, scenes.relations._replace(kind=kind))
    return torch.where(rigid_pairs(piece), JOINT_CODES["fixed"], kind)


def between_pieces(scenes: SceneBatch, kind: Int[Tensor, "batch pairs"]) -> Int[Tensor, "batch pairs"]:
    """Joints of all pairs, closed, each counting for every pair of the two rigid pieces that it joins.

    A hinge or slider that may sit anywhere does so to a whole piece: no motion can tell to which of its bodies.
    """
    piece = piece_index(scenes, scenes.relations._replace(kind=kind))
    a, b = pairs_of(piece.shape[1], piece.device)
    together = (piece[:, :, None] == piece[:, None]).to(torch.float32)
    spread = torch.zeros_like(kind)
    for code in (JOINT_CODES["prismatic"], JOINT_CODES["revolute"]):
        joined = torch.zeros_like(together)
        joined[:, a, b] = joined[:, b, a] = (kind == code).to(joined.dtype)
        spread = torch.where((together @ joined @ together)[:, a, b] > 0, code, spread)
    return torch.where(rigid_pairs(piece), JOINT_CODES["fixed"], spread)


def flush_pairs(scenes: SceneBatch, poses: Float[Tensor, "batch bodies 3"]) -> Bool[Tensor, "batch pairs"]:
    """Pairs of cuboids with parallel sides."""
    a, b = pairs_of(poses.shape[1], poses.device)
    cuboid = scenes.present & ~scenes.is_cylinder
    turned = poses[:, b, 2] - poses[:, a, 2]
    return cuboid[:, a] & cuboid[:, b] & ((2 * turned).sin().abs() < math.sin(2 * PARALLEL))


def rigid_pairs(group: Int[Tensor, "batch bodies"]) -> Bool[Tensor, "batch pairs"]:
    """Pairs of bodies with the same label."""
    a, b = pairs_of(group.shape[1], group.device)
    return group[:, a] == group[:, b]


def unaware(scenes: SceneBatch) -> SceneBatch:
    """The scenes as one sees them who knows neither joints nor masses."""
    return unweighed(hide_relations(scenes, ~rigid_pairs(scenes.group)))


def unweighed(scenes: SceneBatch) -> SceneBatch:
    """The scenes as one sees them who does not know masses."""
    return scenes._replace(
        mass=torch.full_like(scenes.mass, NOMINAL_MASS), mass_known=torch.zeros_like(scenes.mass_known)
    )


def adjacent_pairs(scenes: SceneBatch, poses: Float[Tensor, "batch bodies 3"]) -> Bool[Tensor, "batch pairs"]:
    """Pairs with a surface gap under 2 cm, but for those of one rigid group."""
    relations = start(unaware(scenes), poses).relations
    return relations.remembered & ~relations.known


def touched_pairs(
    adjacent: Bool[Tensor, "batch pairs"], poses: Float[Tensor, "batch frames bodies 3"]
) -> Bool[Tensor, "batch frames pairs"]:
    """Adjacent pairs of which either body has by then been 2 cm away from where it was in the first frame."""
    a, b = pairs_of(poses.shape[2], poses.device)
    away = (poses[..., :2] - poses[:, :1, :, :2]).norm(dim=-1) > SHIFTED
    shifted = away.cummax(1).values
    return adjacent[:, None] & (shifted[..., a] | shifted[..., b])
