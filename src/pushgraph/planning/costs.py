"""Costs of plans: how far from what is wanted the bodies are in every frame, in metres. Differentiable."""

from collections.abc import Callable, Sequence
from itertools import combinations

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from pushgraph import pose
from pushgraph.contact import RoundedBox, signed_gap
from pushgraph.errors import PlanningError
from pushgraph.parts import parts_of
from pushgraph.planning.goal import Goal, index_of
from pushgraph.scene import Scene
from pushgraph.shape import take

Cost = Callable[[Float[Tensor, "*plans frames bodies 3"]], Float[Tensor, "*plans frames"]]
"""Of pose_world_from_body, in the order of the scene's bodies (float64)."""
TURN_ARM = 0.1
"""A turn counts as the way of a point that is this far from the centre (m)."""


def position_cost(scene: Scene, body: str, x: float, y: float) -> Cost:
    """Distance of the body from a place (m)."""
    index, place = index_of(scene, body), torch.tensor([x, y], dtype=torch.float64)
    return lambda poses: _length(poses[..., index, :2] - place)


def pose_cost(scene: Scene, body: str, x: float, y: float, yaw: float) -> Cost:
    """Distance of the body from a pose (m); for its turn see TURN_ARM."""
    index, place = index_of(scene, body), torch.tensor([x, y], dtype=torch.float64)

    def cost(poses: Float[Tensor, "*plans frames bodies 3"]) -> Float[Tensor, "*plans frames"]:
        # The chord of the turn: smooth, and none for whole turns.
        chord = 2 * TURN_ARM * ((poses[..., index, 2] - yaw) / 2).sin()
        return _length(torch.cat((poses[..., index, :2] - place, chord[..., None]), -1))

    return cost


def apart_cost(scene: Scene, bodies: Sequence[str], gap: float) -> Cost:
    """By how much the gap of each pair of these bodies is less than wanted, all pairs together (m)."""
    indices = [index_of(scene, body) for body in bodies]
    if len(set(indices)) < 2:
        raise PlanningError(f"goal: it takes two bodies to be apart, got {', '.join(bodies) or 'none'}")
    parts = parts_of([scene.bodies[index].shape for index in indices])
    owned = [np.flatnonzero(parts.owner == k).tolist() for k in range(len(indices))]
    pairs = [[(m, n) for m in owned[a] for n in owned[b]] for a, b in combinations(range(len(indices)), 2)]
    first, second = np.array([each for pair in pairs for each in pair]).T
    boxes = [RoundedBox(*map(torch.from_numpy, take(parts.boxes, index))) for index in (first, second)]
    pose_body_from_part = torch.from_numpy(parts.pose_body_from_part)

    def cost(poses: Float[Tensor, "*plans frames bodies 3"]) -> Float[Tensor, "*plans frames"]:
        placed = pose.compose(poses[..., indices, :][..., parts.owner, :], pose_body_from_part)
        between = pose.relative(placed[..., first, :], placed[..., second, :])
        boxes_a, boxes_b = (
            RoundedBox(*(some.expand(*between.shape[:-1], *some.shape[1:]) for some in each)) for each in boxes
        )
        of_parts = signed_gap(boxes_a, boxes_b, between).split([len(pair) for pair in pairs], -1)
        gaps = torch.stack([of_pair.amin(-1) for of_pair in of_parts], -1)
        return (gap - gaps).clamp(min=0).sum(-1)

    return cost


def kept_cost(scene: Scene, bodies: Sequence[str]) -> Cost:
    """How far these bodies are from where the scene has them, all together (m)."""
    indices = [index_of(scene, body) for body in bodies]
    places = torch.from_numpy(scene.poses_world_from_body[indices, :2])
    return lambda poses: _length(poses[..., indices, :2] - places).sum(-1)


def cost_of(scene: Scene, goal: Goal) -> Cost:
    """How far the goal's body is from where it shall be, and those to keep from where they are (m)."""
    goal.check(scene)
    x, y = goal.position
    away = position_cost(scene, goal.body, x, y) if goal.yaw is None else pose_cost(scene, goal.body, x, y, goal.yaw)
    if not goal.keep:
        return away
    moved = kept_cost(scene, goal.keep)
    return lambda poses: away(poses) + moved(poses)


def _length(vector: Float[Tensor, "*batch n"]) -> Float[Tensor, "*batch"]:
    """With a gradient at zero, too."""
    return (vector.square().sum(-1) + 1e-16).sqrt()
