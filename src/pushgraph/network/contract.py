"""What a network must offer to be trained, saved, loaded and predicted with: its contract, by task.

A network is an `nn.Module` that keeps one of these. Its constructor takes the settings of its training by name: hidden,
and of networks that propagate steps, too. `pushgraph.network.registry` knows all of them.
"""

from typing import Any, NamedTuple, Protocol, runtime_checkable

from jaxtyping import Bool, Float
from torch import Tensor

from pushgraph.graph.state import Control, State


class Advance(NamedTuple):
    """What a step does.

    motion: how each body's pose changes: x, y (m), yaw (rad), world axes. done: share of its motion that the tool
    makes, all of it where no force limit holds it back.
    """

    motion: Float[Tensor, "batch bodies 3"]
    done: Float[Tensor, " batch"]


class Foresight(NamedTuple):
    """A prediction with what is behind it, for every pair.

    latents: of both edges of a pair, the later body being the receiver of the second; zero where there is none. Those
    of ContactDynamics are CONTACT_STATE. linked: whether the pair shares edges.
    """

    motion: Float[Tensor, "batch bodies 3"]
    latents: Float[Tensor, "batch pairs 2 hidden"]
    linked: Bool[Tensor, "batch pairs"]


@runtime_checkable
class Dynamics(Protocol):
    """What a rollout needs. LONGEST_STEP: how far the tool moves in a step at most (m), by default."""

    LONGEST_STEP: float

    def __call__(self, state: State, control: Control, /) -> Advance:
        """What a step does."""


@runtime_checkable
class Schema(Protocol):
    """What every checkpoint holds of its network."""

    @staticmethod
    def schema() -> dict[str, Any]:
        """What its weights depend on, as JSON: names of its features, and the constants in them. A checkpoint whose
        schema is another is refused."""


@runtime_checkable
class PhysicsNetwork(Dynamics, Schema, Protocol):
    """What `pushgraph train physics` trains: dynamics, and what their training has to know.

    FRAMES_PER_STEP: how many frames steps cover in training, one after the other. SMALL: errors below this many
    units count quadratically. CHAOS: errors of about this many units and more teach less and less: there the
    prediction has gone another way. VELOCITY_NOISE: on what it is told in training of how bodies moved in the frame
    before, unless a recipe says otherwise (units, turns at LEVER).
    """

    FRAMES_PER_STEP: tuple[int, ...]
    SMALL: float
    CHAOS: float
    VELOCITY_NOISE: float

    @staticmethod
    def error_unit(step: Float[Tensor, " batch"], /) -> Float[Tensor, " batch"]:
        """The unit in which training counts errors (m), given the lengths of steps (m)."""


@runtime_checkable
class Foreseeing(Protocol):
    """Physics that beliefs can stand on."""

    def __call__(self, state: State, control: Control, /) -> Advance:
        """What a step does."""

    def foresee(self, state: State, control: Control, /) -> Foresight:
        """Predict, and tell what was in mind."""
