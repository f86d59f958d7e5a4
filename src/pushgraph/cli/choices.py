"""What options may be: typer completes these values and refuses others, before anything is done.

Fixed sets are enums. Names that are kept in a registry are looked up there when they are needed, for the registries'
modules take seconds to import; what is registered by then is valid, too.
"""

from collections.abc import Callable, Iterable
from enum import StrEnum
from typing import Any

from pushgraph.errors import ChoiceError


class Relations(StrEnum):
    """What to take as joined in a prediction."""

    GIVEN = "given"
    NONE = "none"
    BELIEVED = "believed"


class Masses(StrEnum):
    """What to take as known of masses in a prediction."""

    GIVEN = "given"
    MEAN = "mean"
    BELIEVED = "believed"


class KnownRelations(StrEnum):
    """What is known of joints before watching."""

    NONE = "none"
    GIVEN = "given"


class KnownMasses(StrEnum):
    """What is known of masses before watching."""

    GIVEN = "given"
    UNKNOWN = "unknown"


class Animation(StrEnum):
    """Which animation to write."""

    GIF = "gif"
    MP4 = "mp4"
    NONE = "none"


class Robot(StrEnum):
    """What moves the tool."""

    KINEMATIC = "kinematic"
    UR10 = "ur10"


class Arm(StrEnum):
    """Robots that reach only so far."""

    UR10 = "ur10"


class PlanningDynamics(StrEnum):
    """What plans are tried on."""

    LEARNED = "learned"
    MUJOCO = "mujoco"


class Risk(StrEnum):
    """What of the cost is made least."""

    PREDICTED = "predicted"
    EXPECTED = "expected"
    PERCENTILE = "percentile"


class Up(StrEnum):
    """Axis of spatial poses that points off the table."""

    X = "x"
    Y = "y"
    Z = "z"


def one_of(names: Callable[[], Iterable[str]], metavar: str = "NAME") -> dict[str, Any]:
    """Settings of a typer option or argument that is one of the names which a registry holds when it is asked.

    Any other is an error of ours (exit status 1), as it is in Python, and no error of usage (2): what is registered by
    `--import` is no part of the usage.
    """

    def parse(value: str) -> str:
        valid = list(names())
        if value not in valid:
            raise ChoiceError(f"{metavar.lower()} {value!r}: there is none of this name; valid: {', '.join(valid)}")
        return value

    def complete(incomplete: str) -> list[str]:
        return [name for name in names() if name.startswith(incomplete)]

    return {"parser": parse, "autocompletion": complete, "metavar": metavar}


def setups() -> list[str]:
    """What `pushgraph generate` draws."""
    from pushgraph.simulation.lever_setup import LEVER_UP

    return [*drawn_setups(), LEVER_UP]


def drawn_setups() -> list[str]:
    """The setups of planar scenes."""
    from pushgraph.simulation.setups import SETUPS

    return list(SETUPS)


def engines() -> list[str]:
    """What shares out the work of `pushgraph generate`."""
    from pushgraph.dataset.engines import ENGINES

    return list(ENGINES)


def networks(task: str) -> Callable[[], list[str]]:
    """The networks that `pushgraph train` trains for a task."""

    def names() -> list[str]:
        from pushgraph.network.registry import networks_of

        return list(networks_of(task))

    return names


def contenders() -> list[str]:
    """What `pushgraph evaluate clutter` measures."""
    from pushgraph.evaluation.clutter import CONTENDERS

    return list(CONTENDERS)
