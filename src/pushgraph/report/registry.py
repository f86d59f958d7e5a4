"""Suites of one's own by name: what `pushgraph evaluate` measures beside those shipped, and the report shows."""

import re
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple, Protocol, runtime_checkable

from pushgraph.errors import EvaluationError
from pushgraph.report.experiments import EXPERIMENTS, Experiment, counts_of
from pushgraph.report.tables import View

if TYPE_CHECKING:
    from pushgraph.evaluation.results import Results

_TAKEN = {experiment.name for experiment in EXPERIMENTS} | {"real"}


@runtime_checkable
class Measure(Protocol):
    """What a suite must offer: `pushgraph.evaluation.blocks.measure_blocks` does most of it."""

    def __call__(
        self,
        objects: Sequence[int],
        count: int,
        seed: int,
        models: Mapping[str, str],
        workers: int,
        progress: Callable[[int], None],
        /,
    ) -> "Results":
        """The numbers of `count` test scenes for each number of objects, the same for the same seed.

        models: checkpoints by name, each a shipped one's name or a file. workers: processes. progress: is told how
        many scenes are done.
        """


class Suite(NamedTuple):
    """A suite, the shipped checkpoints that it measures unless told others, and what the report shows of it."""

    measure: Measure
    models: tuple[str, ...]
    experiment: Experiment


SUITES: dict[str, Suite] = {}


def register_suite(
    name: str,
    measure: Measure,
    models: Sequence[str],
    views: Sequence[View],
    title: str,
    paper: str = "not studied.",
    counts: tuple[int, int, int] = (6, 20, 200),
) -> None:
    """Make a suite known by name, in this process: to `pushgraph evaluate NAME` and to the report.

    models: shipped checkpoints that are measured unless others are asked for. views: its tables. title, paper: what
    the report says above them. counts: scenes of a quick, a normal and a full report. Processes that are started have
    to import the module that calls this, too. Raises EvaluationError if the name is taken or none.
    """
    if not re.fullmatch(r"[a-z0-9][a-z0-9-]*", name):
        raise EvaluationError(f"suite {name!r}: a name is of small letters, digits and -")
    if name in _TAKEN or (name in SUITES and SUITES[name].measure is not measure):
        raise EvaluationError(f"{name!r}: there is a suite of this name already")
    experiment = Experiment(name, title, paper, ("evaluate", name), counts_of(*counts), tuple(views), {})
    SUITES[name] = Suite(measure, tuple(models), experiment)


def all_experiments() -> tuple[Experiment, ...]:
    """Those that are shipped, then those of one's own."""
    return (*EXPERIMENTS, *(suite.experiment for suite in SUITES.values()))
