"""The two predictors behind one interface: state and control of a frame to the motion of every body in it."""

import math
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from pushgraph import pose
from pushgraph.graph import contact_features as contact_feature_names
from pushgraph.graph import contact_graph as contact_geometry
from pushgraph.graph import propnet_graph as propnet_features
from pushgraph.graph.broad_phase import LEVER
from pushgraph.graph.contact_features import CLAMP, contact_features
from pushgraph.graph.contact_graph import ContactGraph, contact_graph
from pushgraph.graph.pieces import mean_motion, move_pieces
from pushgraph.graph.propnet_graph import DISPLACEMENT, TURN, PropnetGraph, propnet_graph
from pushgraph.graph.scene_batch import tensors_of
from pushgraph.graph.state import Control, State
from pushgraph.graph.steps import LONGEST
from pushgraph.network import contact_problem
from pushgraph.network.contact_network import ContactNetwork
from pushgraph.network.contact_problem import FARTHEST, SLIP, ContactProblem
from pushgraph.network.contract import Advance, Foresight, PhysicsNetwork
from pushgraph.network.image_dynamics import ImageDynamics
from pushgraph.network.newton import solve
from pushgraph.network.point_forces import PointForces, point_forces
from pushgraph.network.propagation import PropagationNetwork

if TYPE_CHECKING:
    from pushgraph.network.compiled.step import Solved

LEAST_UNIT = 3e-3
"""Errors in steps smaller than this (m) count as if they were as large: there contacts give way in simulation."""


class ContactDynamics(nn.Module):
    """Ours: what the laws of contact say, corrected by a network.

    Only what may move moves, and what is one piece stays one.
    """

    LONGEST_STEP = LONGEST
    FRAMES_PER_STEP: tuple[int, ...] = (1, 2, 1, 4)
    SMALL = 0.01
    CHAOS = 1.0
    VELOCITY_NOISE = 0.0

    def __init__(self, hidden: int = 48, steps: int = 2) -> None:
        super().__init__()
        self.network = ContactNetwork(hidden, steps)

    @staticmethod
    def schema() -> dict[str, Any]:
        """Names of the features, and the constants that predictions depend on."""
        schema = _schema(contact_feature_names)
        return schema | {"constants": contact_geometry.CONSTANTS | contact_problem.CONSTANTS | schema["constants"]}

    @staticmethod
    def error_unit(step: Float[Tensor, " batch"]) -> Float[Tensor, " batch"]:
        """Training counts errors in this unit (m): the length of the step."""
        return step.clamp(min=LEAST_UNIT)

    def forward(self, state: State, control: Control) -> Advance:
        """See Dynamics."""
        if self._can_be_compiled(state, control):
            solved = _compiled(state, control)
            motion = torch.from_numpy(solved.motion).to(state.poses.dtype)
            return Advance(motion, torch.from_numpy(solved.done).to(state.poses.dtype))
        graph, _, twist = self._solved(state, control)
        return Advance(self._motion(state, graph, twist), _done(state, graph, twist))

    def foresee(self, state: State, control: Control) -> Foresight:
        """Predict, with the state of every contact."""
        if self._can_be_compiled(state, control):
            return _foreseen(state, _compiled(state, control, contact_state=True))
        graph, problem, twist = self._solved(state, control)
        relation = graph.edges.relation[graph.contacts.points.edge]
        relation = torch.cat((2 * relation, 2 * relation + 1))
        relation = relation.masked_fill(graph.edges.is_tool[graph.contacts.points.edge].repeat(2), -1)
        latents = contact_state(problem, twist)
        return _foresight(self._motion(state, graph, twist), state.relations.kind, relation, latents)

    def forces(self, state: State, control: Control) -> PointForces:
        """Forces at the contacts and joints of a step."""
        graph, problem, twist = self._solved(state, control)
        return point_forces(graph, problem, twist, state.poses.shape[1])

    def _can_be_compiled(self, state: State, control: Control) -> bool:
        """Whether nothing but the motion is asked for, of what is solved as it is, on a processor."""
        if not self.network.is_silent or state.poses.device.type != "cpu":
            return False
        return not (torch.is_grad_enabled() and any(values.requires_grad for values in tensors_of((state, control))))

    def _solved(
        self, state: State, control: Control
    ) -> tuple[ContactGraph, ContactProblem, Float[Tensor, "3 nodes"]]:
        graph = contact_graph(state, control)
        correction = None if self.network.is_silent else self.network(graph, contact_features(state, graph))
        problem = ContactProblem.of(graph, correction)
        return graph, problem, solve(problem)

    def _motion(self, state: State, graph: ContactGraph, twist: Tensor) -> Tensor:
        nodes = graph.nodes
        motion = twist.clamp(-FARTHEST, FARTHEST) * nodes.step / twist.new_tensor([1.0, 1.0, LEVER])[:, None]
        batch, bodies = state.poses.shape[:2]
        free = (~(nodes.given | nodes.is_tool)).nonzero().squeeze(-1)
        by_piece = torch.zeros_like(state.poses).flatten(0, 1)
        by_piece = by_piece.index_copy(0, nodes.body[free], motion.t()[free].to(state.poses.dtype))
        return move_pieces(graph.pieces, state.poses, by_piece.view(batch, bodies, 3))


class PropnetDynamics(nn.Module):
    """The paper's: velocities of every body in its own frame; rigid groups then move with their members' mean."""

    LONGEST_STEP = math.inf
    FRAMES_PER_STEP: tuple[int, ...] = (1,)
    SMALL = 0.3
    """Most bodies rest: were all but the smallest errors counted by their size, it would learn that all do."""
    CHAOS = 10.0
    VELOCITY_NOISE = 0.3
    """From nothing it learns little from exact velocities but to copy them, and its rollouts, which begin at rest,
    stand still."""

    def __init__(self, hidden: int = 256, steps: int = 5) -> None:
        super().__init__()
        self.network = PropagationNetwork(hidden, steps)
        # Training that began with large random motions would first have to unlearn them.
        for values in self.network.head[-1].parameters():
            nn.init.zeros_(values)

    @staticmethod
    def schema() -> dict[str, Any]:
        """Names of the features and the constants in them, which its weights depend on."""
        return _schema(propnet_features)

    @staticmethod
    def error_unit(step: Float[Tensor, " batch"]) -> Float[Tensor, " batch"]:
        """Training counts errors in this unit (m): that of velocities in the features, as in the paper."""
        return torch.full_like(step, DISPLACEMENT)

    def forward(self, state: State, control: Control) -> Advance:
        """See Dynamics; it knows no force limits."""
        graph = propnet_graph(state, control)
        return Advance(self._motion(state, graph, self.network(graph).motion), torch.ones_like(state.poses[:, 0, 0]))

    def foresee(self, state: State, control: Control) -> Foresight:
        """Predict, and tell what was in mind."""
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


def _compiled(state: State, control: Control, contact_state: bool = False) -> "Solved":
    # Compiled code takes half a second to import.
    from pushgraph.network.compiled.step import solve_step

    return solve_step(state, control, contact_state)


def _foreseen(state: State, solved: "Solved") -> Foresight:
    mean = solved.contact_state / np.maximum(solved.contacts, 1)[..., None]
    latents = torch.from_numpy(mean).float()[:, :, None].expand(-1, -1, 2, -1)
    motion = torch.from_numpy(solved.motion).to(state.poses.dtype)
    return Foresight(motion, latents, torch.from_numpy(solved.contacts > 0))


def _done(state: State, graph: ContactGraph, twist: Float[Tensor, "3 nodes"]) -> Float[Tensor, " batch"]:
    """Shares of their motions that tools make."""
    drives, nodes = graph.drives, graph.nodes
    x, y, _ = (twist - nodes.last_twist).index_select(1, drives.node)
    lag = x * drives.axis[0] + y * drives.axis[1]
    done = torch.ones_like(state.poses[:, 0, 0])
    return done.index_copy(0, nodes.scene[drives.node], (1 + lag / drives.length).clamp(0, 1).to(done.dtype))


def contact_state(
    problem: ContactProblem, twist: Float[Tensor, "3 nodes"]
) -> Float[Tensor, "directed state"]:
    """CONTACT_STATE of every contact, seen from its first node, then of all seen from the second."""
    moment = problem.linearize(twist, SLIP, 1.0)
    gap = problem.gap.clamp(-CLAMP, CLAMP)
    parts = (-moment.depth - problem.gap).clamp(-CLAMP, CLAMP)
    columns = (gap, parts, moment.tangential.clamp(-CLAMP, CLAMP), moment.pressing.log1p())
    # From the other end both the motion and the frame turn round.
    return torch.stack(columns, -1).repeat(2, 1).float()


def _foresight(motion: Tensor, kind: Tensor, relation: Tensor, latents: Tensor) -> Foresight:
    """relation: where an edge stands in [batch * pairs * 2], -1 for those of no pair; edges of one pair take their
    mean."""
    edges = (relation >= 0).nonzero().squeeze(-1)
    rows = relation[edges]
    total = latents.new_zeros(2 * kind.numel(), latents.shape[1]).index_add(0, rows, latents[edges])
    count = latents.new_zeros(2 * kind.numel()).index_add(0, rows, torch.ones_like(rows, dtype=latents.dtype))
    dense = total / count.clamp(min=1)[:, None]
    return Foresight(motion, dense.view(*kind.shape, 2, -1), (count > 0).view(*kind.shape, 2)[..., 0])


def _schema(features: ModuleType) -> dict[str, Any]:
    return {
        "node_features": list(features.NODE_FEATURES),
        "edge_features": list(features.EDGE_FEATURES),
        "constants": features.CONSTANTS,
    }


DYNAMICS: dict[str, type[PhysicsNetwork]] = {
    "propnet": PropnetDynamics,
    "contact": ContactDynamics,
    "image": ImageDynamics,
}
"""The predictors by name; see `pushgraph.network.registry`."""
