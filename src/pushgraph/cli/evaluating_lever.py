"""The command `pushgraph evaluate lever-up`."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.progress import Progress, TaskID
from rich.table import Table

from pushgraph.cli.evaluating import CORES, Out, Seed, Workers, say_written
from pushgraph.cli.output import BAR, console

if TYPE_CHECKING:
    from pushgraph.evaluation.results import Results


def lever_up(
    count: Annotated[int, typer.Option(min=1, help="Drives, each levered from its four sides.")] = 120,
    seed: Seed = 1_000_000,
    out: Out = Path("evaluation-lever-up"),
    network: Annotated[str, typer.Option(help="Checkpoint to measure as network; none: only what beside it is.")] = (
        "lever_up"
    ),
    interactions: Annotated[int, typer.Option(min=1, help="That it was trained on, a label of the results.")] = 500,
    workers: Workers = CORES,
) -> None:
    """Predict boards that are levered up out of drives never seen, beside two baselines and the noise floor.

    still: the board stays; rigid: it moves with the screwdriver once touched; noise_floor: the simulator itself,
    started 1 mm and 0.5 degree beside.

    Examples:

    `pushgraph evaluate lever-up --count 120 --out result`

    `pushgraph evaluate lever-up --count 32 --network none`
    """
    from pushgraph.evaluation.lever_up import evaluate_lever_up

    models = {} if network == "none" else {"network": network}
    with Progress(*BAR, console=console) as progress:
        task = progress.add_task("drives", total=count)
        results, cases = evaluate_lever_up(count, seed, models, interactions, workers, partial(_show, progress, task))
    results.save(out / "results.json")
    for subset in ("all", "raised"):
        console.print(_table(results, subset, len(cases) if subset == "all" else sum(case.raised for case in cases)))
    say_written(out)


COMMANDS: dict[str, Callable[..., None]] = {"lever-up": lever_up}


def _show(progress: Progress, task: TaskID, done: int) -> None:
    progress.update(task, completed=done)


def _table(results: "Results", subset: str, count: int) -> Table:
    table = Table(title=f"{count} interactions, {subset} (95 % interval over drives in results.json)")
    columns = ("position (mm)", "rotation (deg)", "rollout (mm)", "ledge (mm)", "none (mm)")
    for name in ("model", *columns):
        table.add_column(name, justify="left" if name == "model" else "right")
    values = {
        (row["model"], row["metric"], row["ledge"]): row["value"]
        for row in results.rows
        if (row["subset"], row["side"]) == (subset, "all")
    }
    position = "final_position_error_mm"
    cells = [(position, "all"), ("final_rotation_error_deg", "all"), ("rollout_position_error_mm", "all")]
    cells += [(position, "with"), (position, "without")]
    for model in dict.fromkeys(key[0] for key in values):
        numbers = [values[model, *cell] for cell in cells]
        table.add_row(model.replace("_", " "), *("-" if v is None else f"{v:.2f}" for v in numbers))
    table.caption = "medians at the end; rollout: mean; ledge, none: position where one stands at the side, or none"
    return table
