"""The commands of `pushgraph evaluate`."""

import itertools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import typer
from rich.progress import Progress
from rich.table import Table

from pushgraph.cli.choices import BeliefSetup
from pushgraph.cli.output import BAR, console
from pushgraph.cores import usable_cores

if TYPE_CHECKING:
    from pushgraph.evaluation.coupled import CoupledErrors
    from pushgraph.evaluation.results import Results

Scenes = TypeVar("Scenes")

app = typer.Typer(help="Measure the shipped networks, or your own.", no_args_is_help=True)


@app.callback()
def evaluate() -> None:
    """Measure the shipped networks, or your own."""


Count = Annotated[int, typer.Option(min=1, help="Scenes for each number of objects.")]
Seed = Annotated[int, typer.Option(min=0, help="From 1,000,000 on: test scenes.")]
Out = Annotated[Path, typer.Option(help="Folder for results.json and figures.")]
Objects = Annotated[int | None, typer.Option(help="6, 9 or 12.", show_default="all three")]
Workers = Annotated[int, typer.Option(min=1, help="Processes.", show_default="one a core")]
CORES = usable_cores()


@app.command("physics")
def physics(
    count: Count = 120,
    seed: Seed = 1_000_000,
    out: Out = Path("evaluation-physics"),
    objects: Objects = None,
    contact: Annotated[str, typer.Option(help="Checkpoint to measure as contact.")] = "contact",
    propnet: Annotated[str, typer.Option(help="Checkpoint to measure as propnet.")] = "propnet",
    workers: Workers = CORES,
) -> None:
    """Roll out `contact` and `propnet` against simulation, beside standing still and the noise floor.

    Examples:

    `pushgraph evaluate physics --count 1000 --objects 9 --out result`

    `pushgraph evaluate physics --count 120 --contact my.safetensors`
    """
    from pushgraph.evaluation.figures import save_histogram
    from pushgraph.evaluation.physics import evaluate_physics

    models = {"propnet": propnet, "contact": contact}
    results, scenes = measure(evaluate_physics, numbers_of(objects), count, seed, models, workers)
    results.save(out / "results.json")
    save_histogram(scenes, ("still", "propnet", "contact", "noise_floor"), out / "histogram.png")
    for number in numbers_of(objects):
        console.print(_physics_table(results, number))
    say_written(out, "histogram.png")


@app.command("belief")
def belief(
    count: Count = 120,
    seed: Seed = 1_000_000,
    out: Out = Path("evaluation-belief"),
    objects: Objects = None,
    belief: Annotated[str, typer.Option(help="Checkpoint to measure as belief.")] = "belief",
    paper_recipe: Annotated[str, typer.Option(help="Checkpoint to measure as paper_recipe.")] = "paper_recipe",
    setup: Annotated[
        BeliefSetup, typer.Option(help="jointed: half with joints anywhere.")
    ] = BeliefSetup.MULTIPLE_PARTS,
    workers: Workers = CORES,
) -> None:
    """Watch test scenes with `belief` and `paper_recipe`, and score what they say is joined, beside perfect inference.

    Examples:

    `pushgraph evaluate belief --count 500 --objects 9 --out result`

    `pushgraph evaluate belief --setup jointed --count 120 --belief my.safetensors`
    """
    from functools import partial

    from pushgraph.evaluation.belief import evaluate_belief
    from pushgraph.evaluation.figures import save_belief_curves, save_reliability

    models = {"belief": belief, "paper_recipe": paper_recipe}
    suite = partial(evaluate_belief, setup=setup.value)
    results, scenes = measure(suite, numbers_of(objects), count, seed, models, workers)
    results.save(out / "results.json")
    save_belief_curves(results.rows, out / "curves.png")
    save_reliability(scenes, tuple(models), out / "reliability.png")
    for number in numbers_of(objects):
        console.print(_belief_table(results, number))
    say_written(out, "curves.png", "reliability.png")


@app.command("coupled")
def coupled(
    count: Count = 120,
    seed: Seed = 1_000_000,
    out: Out = Path("evaluation-coupled"),
    objects: Objects = None,
    contact: Annotated[str, typer.Option(help="Checkpoint that predicts.")] = "contact",
    belief: Annotated[str, typer.Option(help="Checkpoint that watches.")] = "belief",
    workers: Workers = CORES,
) -> None:
    """Predict test scenes with what is believed after so many observed frames, beside true and assumed joints.

    Examples:

    `pushgraph evaluate coupled --count 500 --objects 9 --out result`

    `pushgraph evaluate coupled --count 120 --belief my.safetensors`
    """
    from pushgraph.evaluation.coupled import evaluate_coupled
    from pushgraph.evaluation.figures import save_coupled_curves

    models = {"contact": contact, "belief": belief}
    results, scenes = measure(evaluate_coupled, numbers_of(objects), count, seed, models, workers)
    results.save(out / "results.json")
    save_coupled_curves(scenes, out / "coupled.png")
    for number in numbers_of(objects):
        console.print(_coupled_table(scenes, number))
    say_written(out, "coupled.png")


@app.command("spread")
def spread(
    count: Count = 120,
    seed: Seed = 1_000_000,
    out: Out = Path("evaluation-spread"),
    objects: Annotated[
        list[int] | None, typer.Option(help="6, 9 or 12; may be given several times.", show_default="all three")
    ] = None,
    contact: Annotated[str, typer.Option(help="Checkpoint that predicts.")] = "contact",
    spread: Annotated[str, typer.Option(help="Checkpoint that says how surely.")] = "spread",
    belief: Annotated[str, typer.Option(help="Checkpoint that watches.")] = "belief",
    workers: Workers = CORES,
) -> None:
    """Compare how far off predictions of test scenes may be, as stated, with how far off they are.

    Examples:

    `pushgraph evaluate spread --objects 6 --objects 9 --count 200 --out result`

    `pushgraph evaluate spread --count 120 --spread my.safetensors`
    """
    from pushgraph.evaluation.figures import save_coverage
    from pushgraph.evaluation.spread import evaluate_spread

    models = {"contact": contact, "spread": spread, "belief": belief}
    results, scenes = measure(evaluate_spread, numbers_of(objects), count, seed, models, workers)
    results.save(out / "results.json")
    save_coverage(scenes, out / "coverage.png")
    for number in numbers_of(objects):
        console.print(_spread_table(results, number))
    say_written(out, "coverage.png")


def numbers_of(objects: int | list[int] | None, valid: tuple[int, ...] = (6, 9, 12)) -> tuple[int, ...]:
    """The numbers of objects that are asked for: all that are valid, if none is given."""
    chosen = (objects,) if isinstance(objects, int) else tuple(dict.fromkeys(objects or valid))
    for number in chosen:
        if number not in valid:
            raise typer.BadParameter(f"{number}; valid: {', '.join(map(str, valid))}", param_hint="--objects")
    return chosen


def measure(
    suite: Callable[[tuple[int, ...], int, int, dict[str, str], int, Callable[[int], None]], tuple["Results", Scenes]],
    numbers: tuple[int, ...],
    count: int,
    seed: int,
    models: dict[str, str],
    workers: int,
) -> tuple["Results", Scenes]:
    """Run a suite behind a progress bar."""
    with Progress(*BAR, console=console) as progress:
        task = progress.add_task("scenes", total=count * len(numbers))
        return suite(numbers, count, seed, models, workers, lambda done: progress.update(task, completed=done))


def say_written(out: Path, *figures: str) -> None:
    """Tell where the files are."""
    written = ", ".join(str(out / name) for name in ("results.json", *figures))
    console.print(f"Written: {written}", soft_wrap=True, markup=False)


def _physics_table(results: "Results", objects: int) -> Table:
    table = Table(title=f"Rollouts, {objects} objects (cm; 95 % interval over scenes in results.json)")
    metrics = ("mean_error_cm", "final_error_moved_cm", "median_final_error_moved_cm", "displacement_moved_cm")
    table.add_column("scenes")
    for name in ("frames", "model", "mean error", "final, moved", "median of that", "they moved", "yaw, cuboids (deg)"):
        table.add_column(name, justify="left" if name == "model" else "right")
    values = {
        (row["density"], row["frames"], row["model"], row["metric"]): row["value"]
        for row in results.rows
        if row["objects"] == objects
    }
    last = None
    for density, frames, model in dict.fromkeys(key[:3] for key in values):
        numbers = [values[density, frames, model, metric] for metric in (*metrics, "yaw_error_cuboid_deg")]
        if last not in (None, (density, frames)):
            table.add_section()
        last = density, frames
        table.add_row(density, str(frames), model, *("-" if v is None else f"{v:.2f}" for v in numbers))
    return table


def _belief_table(results: "Results", objects: int) -> Table:
    table = Table(title=f"Accuracy, {objects} objects (95 % interval over scenes in results.json)")
    columns = ("all pairs", "adjacent", "touched", "anywhere", "flush", "ece, adjacent")
    for name in ("frames", "noise", "model", *columns):
        table.add_column(name, justify="left" if name in ("noise", "model") else "right")
    values = {
        tuple(row[name] for name in ("observed_frames", "noise", "model", "metric", "pairs")): row["value"]
        for row in results.rows
        if row["objects"] == objects and row["observed_frames"] in (10, 40, 100, 200)
    }
    wanted = (
        *(("accuracy", pairs) for pairs in ("all", "adjacent", "touched")),
        *(("accuracy_pieces", pairs) for pairs in ("touched_anywhere", "touched_flush")),
        ("ece", "adjacent"),
    )
    order = sorted(dict.fromkeys(key[:3] for key in values), key=lambda key: (key[0], key[1] != "none"))
    for (frames, noise), some in itertools.groupby(order, key=lambda key: key[:2]):
        table.add_section()
        for *_, model in some:
            numbers = [values.get((frames, noise, model, metric, pairs)) for metric, pairs in wanted]
            table.add_row(str(frames), noise, model, *("-" if v is None else f"{v:.3f}" for v in numbers))
    return table


def _spread_table(results: "Results", objects: int) -> Table:
    title = f"Bodies that moved, {objects} objects (95 % interval over scenes in results.json)"
    table = Table(title=title, pad_edge=False)
    columns = ("joints", "masses", "frames", "68 %", "95 %", "rank", "yaw 68 %", "95 %", "rank")
    for name in columns:
        table.add_column(name, justify="left" if name in ("joints", "masses") else "right")
    table.caption = "rank: correlation of spread and error"
    names = ("coverage_68", "coverage_95", "spread_correlation")
    metrics = (*names, *(f"yaw_{name}" for name in names))
    label_names = ("joints", "observed_frames", "masses", "frames")
    values = {
        (*(row[name] for name in label_names), row["metric"]): row["value"]
        for row in results.rows
        if (row["objects"], row["bodies"], row["density"]) == (objects, "moved", "all")
    }
    order = dict.fromkeys(key[:-1] for key in values)
    for condition, some in itertools.groupby(order, key=lambda key: key[:3]):
        table.add_section()
        joints, observed, masses = condition
        for key in some:
            numbers = [values[*key, metric] for metric in metrics]
            told = f"believed, {observed}" if joints == "believed" else joints
            cells = ("-" if v is None else f"{v:.3f}" for v in numbers)
            table.add_row(told, masses, str(key[3]), *cells)
    return table


def _coupled_table(scenes: Sequence["CoupledErrors"], objects: int) -> Table:
    from pushgraph.evaluation.coupled import MODELS, STARTS, mean_and_standard_error

    title = f"Rollouts of 50 frames, {objects} objects (mean error ± standard error, cm)"
    table = Table(title=title, pad_edge=False)
    table.add_column("frames", justify="right")
    columns = []
    for model in MODELS:
        table.add_column(model.replace("_", " "), justify="right")
        columns.append(zip(*mean_and_standard_error(scenes, objects, model), strict=True))
    for frames, *cells in zip(STARTS, *columns, strict=True):
        table.add_row(str(frames), *(f"{mean:.2f}±{error:.2f}" for mean, error in cells))
    return table
