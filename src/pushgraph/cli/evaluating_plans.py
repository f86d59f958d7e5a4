"""The commands of `pushgraph evaluate` that are about plans."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.progress import Progress
from rich.table import Table

from pushgraph.cli import choices
from pushgraph.cli.choices import one_of
from pushgraph.cli.output import BAR, console
from pushgraph.cli.suites import (
    CORES,
    Belief,
    Contact,
    Out,
    Seed,
    Workers,
    measure,
    say_written,
    without_data,
)

if TYPE_CHECKING:
    from pushgraph.evaluation.results import Results


_NO_DATA = without_data(
    "it makes its own pushes, towards goals and one after what came of the last; what recorded pushes did cannot answer"
)


def tools(
    count: Annotated[int | None, typer.Option(min=1, help="Tasks, spread over all.", show_default="all")] = None,
    seed: Seed = 1_000_000,
    out: Out = Path("evaluation-tools"),
    contact: Contact = "contact",
    data: Annotated[str | None, _NO_DATA] = None,
    workers: Workers = CORES,
) -> None:
    """Choose a tool and pushes that bring a cylinder to a goal, predicted and executed, beside MuJoCo as the dynamics.

    Every plan of every start is simulated first, once on a machine: half a minute to a minute.

    Examples:

    `pushgraph evaluate tools --out result`

    `pushgraph evaluate tools --count 40 --contact my.safetensors`
    """
    from pushgraph.evaluation.tool_figures import save_tools
    from pushgraph.evaluation.tools import evaluate_tools

    with Progress(*BAR, console=console) as progress:
        bars = {what: progress.add_task(what, total=None) for what in ("starts", "plans")}
        results, measures = evaluate_tools(
            count,
            seed,
            contact,
            workers,
            lambda what, done, total: progress.update(bars[what], completed=done, total=total),
        )
    results.save(out / "results.json")
    save_tools(results.rows, measures.tasks, out / "tools.png")
    console.print(_tools_table(results, measures.tasks))
    say_written(out, "tools.png")


def clutter(
    count: Annotated[int, typer.Option(min=1, help="Scenes for each number of objects.")] = 60,
    seed: Seed = 1_000_000,
    out: Out = Path("evaluation-clutter"),
    objects: Annotated[int, typer.Option(min=2, help="In a scene.")] = 9,
    contact: Contact = "contact",
    belief: Belief = "belief",
    contender: Annotated[
        list[str] | None,
        typer.Option(
            help="belief, belief_expected, belief_percentile_90, no_joint, true_joints or mujoco; again.",
            show_default="all",
            **one_of(choices.contenders),
        ),
    ] = None,
    data: Annotated[str | None, _NO_DATA] = None,
    workers: Workers = CORES,
) -> None:
    """Bring a body among jointed ones to a place and to a pose 20 cm away, push by push, joints unknown.

    Beside it: planning for the expected or the 90th-percentile cost, as if nothing were joined, with the true joints,
    and by MuJoCo in the same time. About 20 s of one core a scene.

    Examples:

    `pushgraph evaluate clutter --count 60 --out result`

    `pushgraph evaluate clutter --contender belief --contender no_joint`
    """
    from functools import partial

    from pushgraph.evaluation.clutter import CONTENDERS, evaluate_clutter

    contenders = tuple(dict.fromkeys(contender or CONTENDERS))
    suite = partial(evaluate_clutter, contenders=contenders)
    models = {"contact": contact, "belief": belief}
    results, _ = measure(suite, (objects,), count, seed, models, workers)
    results.save(out / "results.json")
    console.print(_clutter_table(results, count))
    say_written(out)


COMMANDS: dict[str, Callable[..., None]] = {"tools": tools, "clutter": clutter}


def _clutter_table(results: "Results", count: int) -> Table:
    table = Table(title=f"{count} scenes, joints unknown (95 % interval over scenes in results.json)", pad_edge=False)
    columns = ("3 cm", "15 deg", "error (cm)", "pushes", "plan (s)", "ece")
    for name in ("goal", "model", *columns):
        table.add_column(name, justify="left" if name in ("goal", "model") else "right")
    values = {(row["goal"], row["model"], row["metric"]): row["value"] for row in results.rows}
    metrics = ("success_3cm", "success_pose", "error_cm", "pushes", "planning_s", "ece")
    last = None
    for goal, model in sorted(dict.fromkeys(key[:2] for key in values), key=lambda key: key[0], reverse=True):
        if last not in (None, goal):
            table.add_section()
        last = goal
        numbers = [values.get((goal, model, metric)) for metric in metrics]
        table.add_row(goal, model.replace("_", " "), *("-" if v is None else f"{v:.2f}" for v in numbers))
    table.caption = "ece: of how likely a push was said to bring the body to its goal"
    return table


def _tools_table(results: "Results", tasks: int) -> Table:
    table = Table(title=f"{tasks} tasks (95 % interval over tasks in results.json)", pad_edge=False)
    for name in ("model", "loop", "executed", "tool", "under 5 cm", "under 10 cm", "mean error (cm)"):
        table.add_column(name, justify="left" if name in ("model", "loop", "executed", "tool") else "right")
    keys = ("model", "loop", "executed", "tool")
    values = {(*(row[key] for key in keys), row["metric"]): row["value"] for row in results.rows}
    seconds = {row["model"]: row["value"] for row in results.rows if row["metric"] == "planning_s"}
    table.caption = "One plan takes " + ", ".join(f"{s:.2f} s ({model})" for model, s in seconds.items())
    last = None
    for key in dict.fromkeys(key[:-1] for key in values if key[-1] == "mean_error_cm"):
        if last not in (None, key[:3]):
            table.add_section()
        last = key[:3]
        near, nearer = values[*key, "success_10cm"], values[*key, "success_5cm"]
        table.add_row(*key, f"{nearer:.3f}", f"{near:.3f}", f"{values[*key, 'mean_error_cm']:.2f}")
    return table
