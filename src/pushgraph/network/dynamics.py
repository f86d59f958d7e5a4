"""The two predictors behind one interface: state and control of a frame to the motion of every body in it."""

from types import ModuleType
from typing import Any, NamedTuple, Protocol, runtime_checkable

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from pushgraph import pose
from pushgraph.graph import contact_graph as contact_features
from pushgraph.graph import propnet_graph as propnet_features
from pushgraph.graph.contact_graph import LEVER, ContactGraph, contact_graph
from pushgraph.graph.near import Reach
from pushgraph.graph.pieces import mean_motion, move_pieces
from pushgraph.graph.propnet_graph import DISPLACEMENT, TURN, PropnetGraph, propnet_graph
from pushgraph.graph.state import Control, State
from pushgraph.network.contact_solver import ContactSolver
from pushgraph.network.joint_projection import hold_joints
from pushgraph.network.propagation import PropagationNetwork

SLOWEST = 2e-4
"""The tool's step in a very slow push (m)."""


@runtime_checkable
class Dynamics(Protocol):
    """What a rollout needs."""

    def __call__(self, state: State, control: Control) -> Float[Tensor, "batch bodies 3"]:
        """How each body's pose changes until the next frame: x, y (m), yaw (rad), world axes."""


class Foresight(NamedTuple):
    """A prediction with what the network had in mind about every pair.

    latents: of both edges of a pair, the later body being the receiver of the second; zero where there is none.
    linked: whether the pair shares edges.
    """

    motion: Float[Tensor, "batch bodies 3"]
    latents: Float[Tensor, "batch pairs 2 hidden"]
    linked: Bool[Tensor, "batch pairs"]


class ContactDynamics(nn.Module):
    """Ours: only pieces that the tool can reach move, and what is one piece stays one."""

    def __init__(self, hidden: int = 96, steps: int = 8) -> None:
        super().__init__()
        self.solver = ContactSolver(hidden, steps)

    @staticmethod
    def schema() -> dict[str, Any]:
        """Names of the features and the constants in them, which its weights depend on."""
        return _schema(contact_features)

    @staticmethod
    def error_unit(step: Float[Tensor, " batch"]) -> Float[Tensor, " batch"]:
        """Training counts errors in this unit (m): the tool's step, or that of a slow push if it is smaller."""
        return step.clamp(min=SLOWEST)

    def forward(self, state: State, control: Control) -> Float[Tensor, "batch bodies 3"]:
        """See Dynamics."""
        graph = contact_graph(state, control)
        return self._motion(state, graph, self.solver(graph).twist)

    def foresee(self, state: State, control: Control, reach: Reach | None = None) -> Foresight:
        """Predict, and tell what was in mind. reach: of the tool in this frame, if it is known already."""
        graph = contact_graph(state, control, reach)
        solution = self.solver(graph)
        return _foresight(
            self._motion(state, graph, solution.twist), state.relations.kind, graph.relation, solution.messages
        )

    def _motion(self, state: State, graph: ContactGraph, twist: Tensor) -> Tensor:
        twist = hold_joints(graph, twist) * graph.step[:, None]
        twist = twist.to(state.poses.dtype) / twist.new_tensor([1.0, 1.0, LEVER])
        batch, bodies = state.poses.shape[:2]
        moving = (~graph.kinematic).nonzero().squeeze(-1)
        by_piece = torch.zeros_like(state.poses).flatten(0, 1).index_copy(0, graph.body[moving], twist[moving])
        return move_pieces(graph.pieces, state.poses, by_piece.view(batch, bodies, 3))


class PropnetDynamics(nn.Module):
    """The paper's: velocities of every body in its own frame; rigid groups then move with their members' mean."""

    def __init__(self, hidden: int = 256, steps: int = 5) -> None:
        super().__init__()
        self.network = PropagationNetwork(hidden, steps)

    @staticmethod
    def schema() -> dict[str, Any]:
        """Names of the features and the constants in them, which its weights depend on."""
        return _schema(propnet_features)

    @staticmethod
    def error_unit(step: Float[Tensor, " batch"]) -> Float[Tensor, " batch"]:
        """Training counts errors in this unit (m): that of velocities in the features, as in the paper."""
        return torch.full_like(step, DISPLACEMENT)

    def forward(self, state: State, control: Control) -> Float[Tensor, "batch bodies 3"]:
        """See Dynamics."""
        graph = propnet_graph(state, control)
        return self._motion(state, graph, self.network(graph).motion)

    def foresee(self, state: State, control: Control, reach: Reach | None = None) -> Foresight:
        """Predict, and tell what was in mind; what the tool can reach does not matter here."""
        graph = propnet_graph(state, control)
        propagated = self.network(graph)
        return _foresight(
            self._motion(state, graph, propagated.motion), state.relations.kind, graph.relation, propagated.effects
        )

    def _motion(self, state: State, graph: PropnetGraph, motion: Tensor) -> Tensor:
        own = motion * graph.yaw.new_tensor([DISPLACEMENT, DISPLACEMENT, TURN])
        world = torch.cat((pose.rotate(own[:, :2], graph.yaw), own[:, 2:]), -1)
        batch, bodies = state.poses.shape[:2]
        width = bodies + state.scenes.parts.radius.shape[1]
        motion = world.new_zeros(batch * width, 3).index_copy(0, graph.slot, world)
        motion = motion.view(batch, width, 3)[:, :bodies]
        return move_pieces(graph.pieces, state.poses, mean_motion(state.scenes, graph.pieces.index, motion))


def _foresight(motion: Tensor, kind: Tensor, relation: Tensor, latents: Tensor) -> Foresight:
    edges = (relation >= 0).nonzero().squeeze(-1)
    dense = latents.new_zeros(2 * kind.numel(), latents.shape[1])
    dense = dense.index_copy(0, relation[edges], latents[edges])
    linked = torch.zeros(2 * kind.numel(), dtype=torch.bool, device=kind.device)
    linked[relation[edges]] = True
    return Foresight(motion, dense.view(*kind.shape, 2, -1), linked.view(*kind.shape, 2)[..., 0])


def _schema(features: ModuleType) -> dict[str, Any]:
    return {
        "node_features": list(features.NODE_FEATURES),
        "edge_features": list(features.EDGE_FEATURES),
        "constants": features.CONSTANTS,
    }


DYNAMICS: dict[str, type[nn.Module]] = {"propnet": PropnetDynamics, "contact": ContactDynamics}
"""The predictors by name."""
