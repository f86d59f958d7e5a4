"""The commands of `pushgraph evaluate` that are about plans."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer
from rich.progress import Progress
from rich.table import Table

from pushgraph.cli.evaluating import CORES, Out, Seed, Workers, say_written
from pushgraph.cli.output import BAR, console


def tools(
    count: Annotated[int | None, typer.Option(min=1, help="Tasks, spread over all.", show_default="all")] = None,
    seed: Seed = 1_000_000,
    out: Out = Path("evaluation-tools"),
    contact: Annotated[str, typer.Option(help="Checkpoint that predicts.")] = "contact",
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


COMMANDS: dict[str, Callable[..., None]] = {"tools": tools}


def _tools_table(results, tasks: int) -> Table:
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
