"""What is answered about the joints of all pairs, from what a network says of each pair by itself.

What is fixed to one body is fixed to each other. Of all joints of a scene only those count for which that holds, each
as likely as the product of what is said of its pairs.
"""

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from pushgraph.graph.joint_truth import rigid_pairs
from pushgraph.graph.scene_batch import JOINT_CODES, SceneBatch
from pushgraph.network.belief_network import Rows

STRANGERS = 0.999
"""Joints join neighbours: probability that a pair which was never adjacent is not joined, unless by a fixed chain."""


class JointAnswers(NamedTuple):
    """What is believed of all pairs.

    probabilities: of every joint, in the order of JOINT_CODES. kind: JOINT_CODES, the likeliest that can all hold at
    once; what is likeliest pair by pair need not.
    """

    probabilities: Float[Tensor, "batch pairs joints"]
    kind: Int[Tensor, "batch pairs"]


def answer_together(
    scenes: SceneBatch, answers: Float[Tensor, "rows joints"], rows: Rows, possible: Bool[Tensor, " joints"]
) -> JointAnswers:
    """Answers about all pairs: those of which the network says something, those that are known, and strangers.

    answers: probabilities, pair by pair. possible: joints that unknown pairs may have.
    """
    # Compiled code takes half a second to import.
    from pushgraph.network.compiled.fixed_pieces import fixed_pieces

    relations, fixed = scenes.relations, JOINT_CODES["fixed"]
    stranger = possible.to(answers.dtype) * ((1 - STRANGERS) / (int(possible.sum()) - 1))
    stranger[JOINT_CODES["none"]] = STRANGERS
    alone = stranger.repeat(*relations.kind.shape, 1)
    if relations.known.any():
        kind = torch.where(rigid_pairs(scenes.group), fixed, relations.kind)
        given = torch.eye(len(JOINT_CODES), dtype=answers.dtype, device=answers.device)[kind]
        alone = torch.where(relations.known[..., None], given, alone)
    alone = alone.index_put((rows.scene, rows.pair), answers)
    answered = torch.zeros_like(relations.known)
    answered[rows.scene, rows.pair] = True

    apart = alone.clone()
    apart[..., fixed] = -1.0
    likeliest_apart = apart.max(-1)
    direct = alone[..., fixed]
    # That a scene names no joint between two bodies does not say that no others fix them to each other.
    said = answered | (relations.known & (direct == 1))
    together, in_piece = np.zeros(direct.shape), np.zeros(direct.shape, bool)
    inputs = (values.double().cpu().numpy() for values in (direct, likeliest_apart.values))
    fixed_pieces(*inputs, said.cpu().numpy(), scenes.mass.shape[1], together, in_piece)
    joined = torch.from_numpy(together).to(alone)
    joined = torch.where(answered, joined, torch.maximum(joined, direct))
    joined = torch.where(relations.known & ~answered, direct, joined)
    probabilities = alone * ((1 - joined) / (1 - direct).clamp(min=1e-9))[..., None]
    probabilities[..., fixed] = joined
    kind = torch.where(torch.from_numpy(in_piece).to(said.device), fixed, likeliest_apart.indices)
    kind = torch.where(relations.known & ~answered, alone.argmax(-1), kind)
    return JointAnswers(probabilities, kind)
