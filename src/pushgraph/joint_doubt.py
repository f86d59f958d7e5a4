"""How probable it is that joints are not what a scene says, where beliefs are given."""

from collections.abc import Mapping, Sequence

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from pushgraph.errors import PredictionError
from pushgraph.graph.scene_batch import JOINT_CODES, map_tensors, pair_index
from pushgraph.graph.state import State
from pushgraph.graph.track_features import default_doubt, doubt_of
from pushgraph.scene import Scene
from pushgraph.scene_parts import in_parts

Beliefs = Mapping[tuple[str, str], Sequence[float] | np.ndarray]
"""Probabilities of none, fixed, prismatic and revolute for pairs of bodies, by name: those of a `BeliefRegulator` are
`dict(zip(regulator.pairs, regulator.probabilities))`. Other pairs count as the scene says."""


def joint_doubt(states: State, scenes: Sequence[Scene], beliefs: Sequence[Beliefs]) -> Float[Tensor, "batch pairs"]:
    """Probability of every pair that what a scene takes for its joint is wrong.

    beliefs: of each scene. Raises PredictionError if they are not one a scene, of its bodies, and probabilities.
    """
    if len(beliefs) != len(scenes):
        raise PredictionError(f"beliefs: one mapping a scene is needed, {len(scenes)}; got {len(beliefs)}")
    states = map_tensors(lambda values: values.cpu(), states)
    relations, bodies = states.relations, states.scenes.mass.shape[1]
    doubt = default_doubt(relations)
    probabilities, believed = torch.zeros(*doubt.shape, len(JOINT_CODES)), torch.zeros_like(doubt, dtype=torch.bool)
    for k, (scene, pairs) in enumerate(zip(scenes, beliefs, strict=True)):
        if pairs and in_parts(scene).scene is not scene:
            raise PredictionError(f"beliefs: scene {k} has polygons, of which no joints are believed")
        index = {name: body for body, name in enumerate(scene.names)}
        for names, row in pairs.items():
            unknown = [name for name in names if name not in index]
            values = np.asarray(row, dtype=float)
            if unknown or len(set(names)) != 2:
                raise PredictionError(f"beliefs: {names!r} is no pair of bodies of scene {k}: {', '.join(scene.names)}")
            if values.shape != (len(JOINT_CODES),) or not (values >= 0).all() or abs(values.sum() - 1) > 1e-3:
                raise PredictionError(
                    f"beliefs: {names!r}: must be probabilities of {', '.join(JOINT_CODES)}, got {values.tolist()}"
                )
            a, b = sorted(index[name] for name in names)
            pair = pair_index(a, b, bodies)
            probabilities[k, pair], believed[k, pair] = torch.from_numpy(values).float(), True
    return torch.where(believed, doubt_of(states.scenes, relations, probabilities), doubt)
