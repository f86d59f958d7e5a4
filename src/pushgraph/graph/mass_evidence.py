"""How what a step shows depends on masses: predictions with each mass a little larger and smaller.

Where a body is after a step depends on masses now, and on masses before since that is where it came from: the
sensitivity of tracked poses is carried from step to step.
"""

from typing import NamedTuple, Protocol

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from pushgraph.graph.broad_phase import LEVER
from pushgraph.graph.scene_batch import map_tensors
from pushgraph.graph.state import Control, State
from pushgraph.graph.tool_wrench import wrench_on_tool

MOVES = 1e-4
"""What moves by less than this in a step (m) rests."""
SENSED = 1e-6
"""Smaller sensitivities (m) are none."""


class Dynamics(Protocol):
    """What predicts a step; see `pushgraph.network.dynamics`."""

    def __call__(self, state: State, control: Control) -> "Motion":
        """What a step does."""


class Motion(Protocol):
    """What a step does."""

    motion: Float[Tensor, "batch bodies 3"]


class Linearized(NamedTuple):
    """A step about assumed masses. Variables are the logarithms of masses, and last that of the table's friction.

    motion: as predicted (m, rad). sensitivity: of poses after the step, turns at LEVER (m). curvature: squared length
    of what the sensitivity misses (m^2). moves: bodies that take part. wrench: on the tool (N, N m), with its
    sensitivity and what that misses.
    """

    motion: Float[Tensor, "batch bodies 3"]
    sensitivity: Float[Tensor, "batch bodies 3 variables"]
    curvature: Float[Tensor, "batch bodies"]
    moves: Bool[Tensor, "batch bodies"]
    wrench: Float[Tensor, "batch 3"]
    wrench_sensitivity: Float[Tensor, "batch 3 variables"]
    wrench_curvature: Float[Tensor, "batch 3"]


def linearize(
    dynamics: Dynamics,
    state: State,
    control: Control,
    log_mass: Float[Tensor, "batch variables"],
    spread: Float[Tensor, "batch variables"],
    carried: Float[Tensor, "batch bodies 3 variables"],
) -> Linearized:
    """Predict a step with the assumed masses, and with that of every body that moves larger and smaller by `spread`.

    carried: sensitivity of the poses of `state`.
    """
    bodies = state.poses.shape[1]
    assumed = with_masses(state, log_mass)
    motion = dynamics(assumed, control).motion
    moves = (motion[..., :2].norm(dim=-1) > MOVES) | (carried.abs().amax((2, 3)) > SENSED)
    wrench = _wrench(assumed, motion, control)
    taking_part = moves & state.scenes.present & ~state.scenes.immovable
    scene, body = taking_part.nonzero(as_tuple=True)
    scale = motion.new_tensor([1.0, 1.0, LEVER])
    sensitivity = torch.zeros_like(carried)
    curvature, wrench_curvature = torch.zeros_like(motion[..., 0]), torch.zeros_like(wrench)
    wrench_sensitivity = wrench.new_zeros(*wrench.shape, log_mass.shape[1])
    wrench_sensitivity[..., -1] = wrench
    if not len(scene):
        return Linearized(motion, carried, curvature, moves, wrench, wrench_sensitivity, wrench_curvature)

    step = spread[scene, body]
    varied = log_mass[scene].repeat(2, 1)
    varied[torch.arange(2 * len(scene)), body.repeat(2)] += torch.cat((step, -step))
    offset = carried[scene, :, :, body] / scale * step[:, None, None]
    offset = torch.cat((offset, -offset))
    both = scene.repeat(2)
    state, control = (map_tensors(lambda values: values[both], batch) for batch in (state, control))
    around = with_masses(state._replace(poses=state.poses + offset), varied)
    moved = dynamics(around, control).motion
    larger, smaller = ((moved + offset) * scale).chunk(2)
    sensitivity[scene, :, :, body] = (larger - smaller) / (2 * step)[:, None, None]
    missed = (larger + smaller) / 2 - motion[scene] * scale
    curvature = curvature.index_add(0, scene, missed.square().sum(-1))
    # All masses twice as large move alike: what is left of the sum comes from the finite differences.
    count = taking_part.sum(1).clamp(min=1)
    sensitivity[..., :bodies] -= (sensitivity.sum(-1) / count[:, None, None])[..., None] * taking_part[:, None, None]

    felt = _wrench(around, moved, control)
    larger, smaller = felt.chunk(2)
    wrench_sensitivity[scene, :, body] = (larger - smaller) / (2 * step)[:, None]
    missed = (larger + smaller) / 2 - wrench[scene]
    wrench_curvature = wrench_curvature.index_add(0, scene, missed.square())
    return Linearized(motion, sensitivity, curvature, moves, wrench, wrench_sensitivity, wrench_curvature)


def with_masses(state: State, log_mass: Float[Tensor, "batch variables"]) -> State:
    """The state with these masses, and this friction of the table."""
    mass, friction = log_mass[:, :-1].exp(), log_mass[:, -1].exp()
    scenes = state.scenes
    mass = torch.where(scenes.immovable, scenes.mass.to(mass.dtype), mass)
    return state._replace(scenes=scenes._replace(mass=mass, table_friction=friction))


def _wrench(state: State, motion: Float[Tensor, "batch bodies 3"], control: Control) -> Float[Tensor, "batch 3"]:
    middle = control.pose + control.motion / 2
    return wrench_on_tool(state.scenes, state.poses, state.motions, motion, middle)
