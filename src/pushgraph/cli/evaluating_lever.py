"""The command `pushgraph evaluate lever-up`."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.progress import Progress, TaskID
from rich.table import Table

from pushgraph.cli.output import BAR, console
from pushgraph.cli.suites import CORES, Models, Out, Seed, Workers, models_of, say_written, without_data

if TYPE_CHECKING:
    from pushgraph.evaluation.lever_up import LeverCase
    from pushgraph.evaluation.results import Results

_NO_DATA = without_data(
    "boards are levered from the four sides of drives that it draws itself; choose others by --seed and --count"
)
FINAL = ("final_position_error_mm", "final_rotation_error_deg")


def lever_up(
    count: Annotated[int, typer.Option(min=1, help="Drives, each levered from its four sides.")] = 120,
    seed: Seed = 1_000_000,
    out: Out = Path("evaluation-lever-up"),
    model: Models = None,
    data: Annotated[str | None, _NO_DATA] = None,
    workers: Workers = CORES,
) -> None:
    """Predict boards that are levered up out of drives never seen, beside two baselines and the noise floor.

    still: the board stays; rigid: it moves with the screwdriver once touched; noise_floor: the simulator itself,
    started 1 mm and 0.5 degree beside. Pictures and animations show two raised boards: the first model's error is the
    median there, or the largest; transparent is where the board truly is.

    Examples:

    `pushgraph evaluate lever-up --count 120 --out result`

    `pushgraph evaluate lever-up --count 32 --model lever_up --model mine=my.safetensors`
    """
    from pushgraph.evaluation.lever_up import BASELINES, NOISE_FLOOR, evaluate_lever_up

    models = models_of(model, ("lever_up", "lever_up_propnet"), (*BASELINES, NOISE_FLOOR))
    with Progress(*BAR, console=console) as progress:
        task = progress.add_task("drives", total=count)
        results, cases = evaluate_lever_up(count, seed, models, workers, partial(_show, progress, task))
    results.save(out / "results.json")
    for subset in ("all", "raised"):
        console.print(_table(results, subset, len(cases) if subset == "all" else sum(case.raised for case in cases)))
    console.print(_table_of_groups(results))
    with console.status("Drawing"):
        _show_cases(cases, seed, next(iter(models.items())), out)
    say_written(out)


COMMANDS: dict[str, Callable[..., None]] = {"lever-up": lever_up}


def _show(progress: Progress, task: TaskID, done: int) -> None:
    progress.update(task, completed=done)


def _show_cases(cases: Sequence["LeverCase"], seed: int, model: tuple[str, str], out: Path) -> None:
    """Pictures and animations of the raised boards whose error is the median, and the largest."""
    from pushgraph.evaluation.lever_up import load_without_range, rigid
    from pushgraph.simulation.lever_setup import SIDES, draw_interaction
    from pushgraph.viewer.lever import save_lever_animation, save_lever_picture

    shown, path = model
    predictor = load_without_range(path)
    raised = sorted((case for case in cases if case.raised), key=lambda case: case.errors[shown].final_position)
    for name, case in {"median": raised[len(raised) // 2], "largest": raised[-1]}.items() if raised else ():
        true = draw_interaction(seed, case.drive * len(SIDES) + SIDES.index(case.side)).track
        tracks = {"Simulated": true, "Predicted": predictor.predict(true.scene), "Rigid": rigid(true.scene)}
        save_lever_picture(tracks, out / f"{name}.png")
        save_lever_animation(tracks, out / f"{name}.gif")


def _table(results: "Results", subset: str, count: int) -> Table:
    table = Table(title=f"{count} interactions, {subset} (95 % interval over drives in results.json)")
    for name in ("model", "position (mm)", "rotation (deg)", "rollout (mm)"):
        table.add_column(name, justify="left" if name == "model" else "right")
    values = _values(results, subset)
    for model in dict.fromkeys(row["model"] for row in results.rows):
        numbers = [values[model, metric, "all", "all"] for metric in (*FINAL, "rollout_position_error_mm")]
        table.add_row(model.replace("_", " "), *map(_told, numbers))
    table.caption = "medians at the end; rollout: mean over its frames"
    return table


def _table_of_groups(results: "Results") -> Table:
    """Of raised boards, by the side from which they are levered, and by whether a ledge stands at that side."""
    from pushgraph.simulation.lever_setup import SIDES

    models = list(dict.fromkeys(row["model"] for row in results.rows))
    table = Table(title="Raised boards: mm / degrees at the end, medians", pad_edge=False)
    table.add_column("", no_wrap=True, min_width=len("with a ledge"))
    for name in models:
        table.add_column(name.replace("_", " "), justify="right")
    values = _values(results, "raised")
    groups = {f"{side} side": (side, "all") for side in SIDES}
    groups |= {"with a ledge": ("all", "with"), "without": ("all", "without")}
    for name, group in groups.items():
        table.add_row(name, *(" / ".join(_told(values[model, metric, *group]) for metric in FINAL) for model in models))
    return table


def _values(results: "Results", subset: str) -> dict[tuple[str, ...], float | None]:
    """By model, metric, side and ledge."""
    labels = ("model", "metric", "side", "ledge")
    return {tuple(row[name] for name in labels): row["value"] for row in results.rows if row["subset"] == subset}


def _told(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"
