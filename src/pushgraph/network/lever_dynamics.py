"""Two predictors of boards among boxes behind one interface: state and way of the tool in a frame to the next state."""

from typing import Any, cast

import torch
from jaxtyping import Float
from torch import Tensor, nn

from pushgraph import pose_3d
from pushgraph.graph import lever_graph as features
from pushgraph.graph.lever_batch import LeverState
from pushgraph.graph.lever_graph import DISPLACEMENT, TURN, LeverGraph, lever_graph
from pushgraph.network import body_step
from pushgraph.network.body_step import step
from pushgraph.network.propagation import PropagationNetwork
from pushgraph.track_frames import FRAME

KNOTS = 2
"""Parts of a frame in which the tool's way is told."""
WRENCH = 0.3
"""Unit of corrections: of forces over the board's weight, of torques over that times its largest half size."""


class LeverDynamics(nn.Module):
    """What it takes to predict boards: the network of the paper in space, one answer of six numbers for each."""

    def __init__(self, hidden: int = 64, steps: int = 2) -> None:
        super().__init__()
        counts = {"node_features": len(features.NODE_FEATURES), "edge_features": len(features.EDGE_FEATURES)}
        self.network = PropagationNetwork(hidden, steps, dropout=0.0, freedoms=6, **counts)

    @staticmethod
    def schema() -> dict[str, Any]:
        """Names of the features and the constants that predictions depend on."""
        return {
            "node_features": list(features.NODE_FEATURES),
            "edge_features": list(features.EDGE_FEATURES),
            "constants": features.CONSTANTS | {"knots": KNOTS},
        }

    def _answer(self, graph: LeverGraph, count: int) -> Float[Tensor, "batch 6"]:
        return self.network(graph).motion[:count] * graph.touched[:, None]


class LeverContact(LeverDynamics):
    """Ours: the laws of contact, corrected by a force and a torque on the board that a network finds."""

    def __init__(self, hidden: int = 64, steps: int = 2) -> None:
        super().__init__(hidden, steps)
        nn.init.zeros_(self._last.weight)
        nn.init.zeros_(self._last.bias)

    @staticmethod
    def schema() -> dict[str, Any]:
        """Of LeverDynamics, and what the laws depend on."""
        schema = LeverDynamics.schema()
        return schema | {"constants": schema["constants"] | body_step.CONSTANTS | {"wrench": WRENCH}}

    @property
    def is_silent(self) -> bool:
        """Whether it corrects nothing, as before training, and is not being trained."""
        return not self.training and not (self._last.weight.any() or self._last.bias.any())

    @property
    def _last(self) -> nn.Linear:
        return cast(nn.Linear, self.network.head[-1])

    def forward(self, state: LeverState, tool: Float[Tensor, "batch knots 7"]) -> LeverState:
        """See LeverDynamics."""
        wrench = None if self.is_silent else self._wrench(state, tool)
        for k in range(KNOTS):
            state = step(state, tool[:, k], tool[:, k + 1], FRAME / KNOTS, wrench)
        return state

    def _wrench(self, state: LeverState, tool: Float[Tensor, "batch knots 7"]) -> Float[Tensor, "batch 6"]:
        scenes = state.scenes
        answer = self._answer(lever_graph(state, tool[:, 0], tool[:, -1]), len(state.pose))
        weight = WRENCH * scenes.mass * scenes.gravity.norm(dim=-1)
        turning = weight * scenes.board_half.amax(-1)
        scaled = torch.cat((answer[:, :3] * weight[:, None], answer[:, 3:] * turning[:, None]), -1)
        return _to_world(scaled, state)


class LeverPropnet(LeverDynamics):
    """The paper's: the network tells how the board moves in its own frame."""

    def forward(self, state: LeverState, tool: Float[Tensor, "batch knots 7"]) -> LeverState:
        """See LeverDynamics."""
        graph = lever_graph(state, tool[:, 0], tool[:, -1])
        own = self._answer(graph, len(state.pose)) * state.pose.new_tensor([DISPLACEMENT] * 3 + [TURN] * 3)
        moved = pose_3d.normalized(pose_3d.compose(state.pose, pose_3d.exponential(own)))
        pose = torch.where(graph.touched[:, None], moved, state.pose)
        return LeverState(state.scenes, pose, _to_world(own, state) / FRAME)


def _to_world(vectors: Float[Tensor, "batch 6"], state: LeverState) -> Float[Tensor, "batch 6"]:
    """Two vectors of a board's own frame in world axes."""
    quaternion = state.pose[:, 3:]
    return torch.cat((pose_3d.rotate(vectors[:, :3], quaternion), pose_3d.rotate(vectors[:, 3:], quaternion)), -1)


LEVERS: dict[str, type[nn.Module]] = {"lever_up": LeverContact, "lever_up_propnet": LeverPropnet}
"""The predictors of boards by name."""
