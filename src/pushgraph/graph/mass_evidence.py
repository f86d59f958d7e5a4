"""How what a step shows depends on masses: predictions with each mass a little larger and smaller.

Where a body is after a step depends on masses now, and on masses before since that is where it came from: the
sensitivity of tracked poses is carried from step to step.
"""

from typing import NamedTuple, Protocol, runtime_checkable

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from pushgraph.graph.broad_phase import LEVER
from pushgraph.graph.state import Control, State
from pushgraph.graph.tool_wrench import ToolWrench, wrench_on_tool

MOVES = 1e-4
"""What moves by less than this in a step (m) rests."""
SENSED = 1e-6
"""Smaller sensitivities (m) are none."""


@runtime_checkable
class Dynamics(Protocol):
    """What predicts a step; see `pushgraph.network.dynamics`."""

    def __call__(self, state: State, control: Control, /) -> "Motion":
        """What a step does."""


@runtime_checkable
class Motion(Protocol):
    """What a step does."""

    @property
    def motion(self) -> Float[Tensor, "batch bodies 3"]:
        """How each body's pose changes."""


class Felt(NamedTuple):
    """What a step exerts on the tool, about assumed masses.

    wrench: N, N m. sensitivity: to the variables. curvature: squares of what that misses. doubt: see `ToolWrench`.
    """

    wrench: Float[Tensor, "batch 3"]
    sensitivity: Float[Tensor, "batch 3 variables"]
    curvature: Float[Tensor, "batch 3"]
    doubt: Float[Tensor, " batch"]


class Linearized(NamedTuple):
    """A step about assumed masses. Variables are the logarithms of masses, and last that of the table's friction.

    motion: as predicted (m, rad). sensitivity: of poses after the step, turns at LEVER (m). curvature: squared length
    of what the sensitivity misses (m^2). moves: bodies that take part. felt: None where no force is measured.
    """

    motion: Float[Tensor, "batch bodies 3"]
    sensitivity: Float[Tensor, "batch bodies 3 variables"]
    curvature: Float[Tensor, "batch bodies"]
    moves: Bool[Tensor, "batch bodies"]
    felt: Felt | None


class Rows(NamedTuple):
    """Steps side by side, one or several of each scene.

    carried: sensitivity of the poses at their beginning (m, turns at LEVER). moves: bodies that take part. blur: how
    far poses may be off (m).
    """

    scene: Int[Tensor, " rows"]
    poses: Float[Tensor, "rows bodies 3"]
    motions: Float[Tensor, "rows bodies 3"]
    carried: Float[Tensor, "rows bodies 3 variables"]
    moves: Bool[Tensor, "rows bodies"]
    blur: Float[Tensor, " rows"]


def linearize(
    dynamics: Dynamics,
    state: State,
    control: Control,
    rows: Rows,
    log_mass: Float[Tensor, "rows variables"],
    spread: Float[Tensor, "rows variables"],
    felt: bool = False,
) -> Linearized:
    """Predict steps with assumed masses, and with that of every body that moves larger and smaller by `spread`.

    state: of the scenes; poses and motions are those of the rows. control: of the rows. felt: whether to say what the
    tool feels.
    """
    bodies, count = rows.poses.shape[1], len(rows.scene)
    scenes = state.scenes
    taking_part = rows.moves & (scenes.present & ~scenes.immovable)[rows.scene]
    row, body = taking_part.nonzero(as_tuple=True)
    scale = rows.poses.new_tensor([1.0, 1.0, LEVER])
    step = spread[row, body]
    everyone = torch.cat((torch.arange(count, device=row.device), row, row))
    masses, poses = log_mass[everyone], rows.poses[everyone]
    offset = rows.carried[row, :, :, body] / scale * step[:, None, None]
    varied = torch.arange(count, len(everyone), device=row.device)
    masses[varied, body.repeat(2)] += torch.cat((step, -step))
    offset = torch.cat((torch.zeros_like(rows.poses), offset, -offset))
    scenes = scenes._replace(relations=state.relations).take(rows.scene[everyone])
    of_rows = State(scenes, poses + offset, rows.motions[everyone], scenes.relations, state.still)
    steps = control.take(everyone)
    around = with_masses(of_rows, masses)
    motions = dynamics(around, steps).motion
    ends = (motions + offset) * scale

    (motion, larger, smaller), sizes = ends.split((count, len(row), len(row))), 2 * step
    sensitivity = torch.zeros_like(rows.carried)
    sensitivity[row, :, :, body] = (larger - smaller) / sizes[:, None, None]
    missed = ((larger + smaller) / 2 - motion[row]).square().sum(-1)
    curvature = torch.zeros_like(motion[..., 0]).index_add(0, row, missed)
    # All masses twice as large move alike: what is left of the sum comes from the finite differences.
    share = taking_part / taking_part.sum(1, keepdim=True).clamp(min=1)
    sensitivity[..., :bodies] -= sensitivity.sum(-1, keepdim=True) * share[:, None, None]

    linearized = Linearized(motion / scale, sensitivity, curvature, rows.moves, None)
    if not felt:
        return linearized
    wrenches, doubts = _wrench(around, motions, steps, rows.blur[everyone])
    wrench, larger, smaller = wrenches.split((count, len(row), len(row)))
    sensitivity = wrench.new_zeros(*wrench.shape, log_mass.shape[1])
    sensitivity[..., -1] = wrench
    sensitivity[row, :, body] = (larger - smaller) / sizes[:, None]
    missed = ((larger + smaller) / 2 - wrench[row]).square()
    curvature = torch.zeros_like(wrench).index_add(0, row, missed)
    doubt, doubt_of_larger, _ = doubts.split((count, len(row), len(row)))
    doubt = doubt.scatter_reduce(0, row, doubt_of_larger, "amax")
    return linearized._replace(felt=Felt(wrench, sensitivity, curvature, doubt))


def moving(
    motion: Float[Tensor, "batch bodies 3"], carried: Float[Tensor, "batch bodies 3 variables"]
) -> Bool[Tensor, "batch bodies"]:
    """Bodies that take part in a step: they move, or masses have to do with where they are."""
    return (motion[..., :2].norm(dim=-1) > MOVES) | (carried.abs().amax((2, 3)) > SENSED)


def with_masses(state: State, log_mass: Float[Tensor, "batch variables"]) -> State:
    """The state with these masses, and this friction of the table."""
    mass, friction = log_mass[:, :-1].exp(), log_mass[:, -1].exp()
    scenes = state.scenes
    mass = torch.where(scenes.immovable, scenes.mass.to(mass.dtype), mass)
    return state._replace(scenes=scenes._replace(mass=mass, table_friction=friction))


def _wrench(
    state: State, motion: Float[Tensor, "batch bodies 3"], control: Control, blur: Float[Tensor, " batch"]
) -> ToolWrench:
    middle = control.pose + control.motion / 2
    return wrench_on_tool(state.scenes, state.poses, state.motions, motion, middle, blur)
