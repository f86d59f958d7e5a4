"""What is truly joined, as it is scored, and which pairs could show it."""

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from pushgraph.graph.pieces import piece_index
from pushgraph.graph.scene_batch import JOINT_CODES, SceneBatch, hide_relations, pairs_of
from pushgraph.graph.state import start
from pushgraph.scene import NOMINAL_MASS

SHIFTED = 0.02
"""An adjacent pair is touched once either of its bodies has moved this far (m)."""


def true_joints(scenes: SceneBatch) -> Int[Tensor, "batch pairs"]:
    """JOINT_CODES of all pairs; no motion can tell what holds a rigid piece together, so all in it is fixed."""
    piece = piece_index(scenes, scenes.relations)
    return torch.where(rigid_pairs(piece), JOINT_CODES["fixed"], scenes.relations.kind)


def rigid_pairs(group: Int[Tensor, "batch bodies"]) -> Bool[Tensor, "batch pairs"]:
    """Pairs of bodies with the same label."""
    a, b = pairs_of(group.shape[1], group.device)
    return group[:, a] == group[:, b]


def unaware(scenes: SceneBatch) -> SceneBatch:
    """The scenes as one sees them who knows neither joints nor masses."""
    scenes = hide_relations(scenes, ~rigid_pairs(scenes.group))
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
