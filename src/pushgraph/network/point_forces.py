"""Forces at contacts and joints, from the solution of a step."""

from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from pushgraph.graph.broad_phase import LEVER
from pushgraph.graph.contact_graph import ContactGraph
from pushgraph.network.contact_problem import SLIP, ContactProblem


class PointForces(NamedTuple):
    """Where pieces touch or are joined in a step.

    scene: of the batch. first, second: bodies of the scene, -1 for the tool. point: in the middle of the step, world
    (m). force: what the second bears (N, world). joint: whether the two are joined there, rather than touch.
    """

    scene: Int[Tensor, " points"]
    first: Int[Tensor, " points"]
    second: Int[Tensor, " points"]
    point: Float[Tensor, "points 2"]
    force: Float[Tensor, "points 2"]
    joint: Bool[Tensor, " points"]


def point_forces(
    graph: ContactGraph, problem: ContactProblem, twist: Float[Tensor, "3 nodes"], bodies: int
) -> PointForces:
    """Of the twists that solve the problem of a graph. bodies: of a scene."""
    nodes, edges, points = graph.nodes, graph.edges, problem.points
    x, y, _ = problem.linearize(twist, SLIP, 1.0).forces()
    first, second = (ends[points.edge] % bodies for ends in (edges.first_body, edges.second_body))
    return PointForces(
        scene=edges.scene[points.edge],
        first=first,
        second=second.masked_fill(edges.is_tool[points.edge], -1),
        point=nodes.centre[points.first] + points.first_arm.t() * LEVER,
        force=-torch.stack((x, y), -1) * nodes.force[points.first, None],
        joint=torch.arange(len(points.edge), device=points.edge.device) >= problem.contacts,
    )
