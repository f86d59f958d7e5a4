"""The commands of `pushgraph evaluate` that are about masses."""

import itertools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.progress import Progress
from rich.table import Table

from pushgraph.cli.output import BAR, console
from pushgraph.cli.suites import (
    CORES,
    COUNT,
    Belief,
    Contact,
    Count,
    Data,
    Models,
    Objects,
    Out,
    Seed,
    Workers,
    measure,
    models_of,
    numbers_measured,
    numbers_of,
    say_written,
    without_data,
)

if TYPE_CHECKING:
    from pushgraph.evaluation.controlled_masses import ControlledScene
    from pushgraph.evaluation.coupled import CoupledErrors
    from pushgraph.evaluation.results import Results

_NO_DATA = without_data(
    "it compares beliefs with simulations of every ratio of masses in its own two scenes; give --data to masses instead"
)


def masses(
    count: Count = None,
    seed: Seed = 1_000_000,
    out: Out = Path("evaluation-masses"),
    objects: Objects = None,
    data: Data = None,
    model: Models = None,
    workers: Workers = CORES,
) -> None:
    """Watch test scenes with `belief` or your own, and score what it says bodies weigh, beside the best that motion
    allows.

    Examples:

    `pushgraph evaluate masses --count 500 --objects 9 --out result`

    `pushgraph evaluate masses --count 120 --model belief --model mine=my.safetensors`
    """
    from pushgraph.evaluation.mass_figures import save_mass_curves
    from pushgraph.evaluation.masses import OBSERVERS, evaluate_masses

    models = models_of(model, ("belief",), OBSERVERS)
    results, _ = measure(evaluate_masses, numbers_of(objects, data=data), count, seed, models, workers, data)
    results.save(out / "results.json")
    save_mass_curves(results.rows, out / "curves.png")
    for number in numbers_measured(results):
        console.print(*_masses_tables(results, number))
    say_written(out, "curves.png")


def controlled_masses(
    count: Count = None,
    seed: Seed = 1_000_000,
    out: Out = Path("evaluation-controlled-masses"),
    objects: Annotated[list[int] | None, typer.Option(help="2 or 3; again.", show_default="both")] = None,
    data: Annotated[str | None, _NO_DATA] = None,
    model: Models = None,
    workers: Workers = CORES,
) -> None:
    """Compare what `belief` or your own says of two scenes of which only the masses change with the best that can be
    said.

    For that, every ratio of masses is simulated, the first time on a machine: some minutes.

    Examples:

    `pushgraph evaluate controlled-masses --count 1000 --out result`

    `pushgraph evaluate controlled-masses --objects 2 --model mine=my.safetensors`
    """
    from pushgraph.evaluation.controlled_masses import OBSERVERS, SETUP, evaluate_controlled_masses
    from pushgraph.evaluation.mass_figures import save_alike, save_confusion, save_mass_histograms

    models, numbers, count = models_of(model, ("belief",), OBSERVERS), numbers_of(objects, SETUP), count or COUNT
    with Progress(*BAR, console=console) as progress:
        once = progress.add_task("simulations, once", total=None, visible=False)
        task = progress.add_task("scenes", total=count * len(numbers))
        results, scenes = evaluate_controlled_masses(
            numbers,
            count,
            seed,
            models,
            workers,
            lambda done: progress.update(task, completed=done),
            lambda done, total: progress.update(once, completed=done, total=total, visible=True),
        )
    results.save(out / "results.json")
    save_mass_histograms(scenes, out / "histograms.png")
    save_confusion(scenes, out / "confusion.png")
    written = ["histograms.png", "confusion.png"]
    if save_alike(scenes, out / "alike.png"):
        written.append("alike.png")
    for number in numbers:
        console.print(*_controlled_tables(results, scenes, number))
    say_written(out, *written)


def coupled_masses(
    count: Count = None,
    seed: Seed = 1_000_000,
    out: Out = Path("evaluation-coupled-masses"),
    objects: Objects = None,
    data: Data = None,
    contact: Contact = "contact",
    belief: Belief = "belief",
    workers: Workers = CORES,
) -> None:
    """Predict test scenes with the masses believed after so many observed frames, beside true and mean ones, and those
    of an observer who knows the exact ratios of what touched so far.

    Examples:

    `pushgraph evaluate coupled-masses --count 500 --objects 9 --out result`

    `pushgraph evaluate coupled-masses --count 120 --belief my.safetensors`
    """
    from pushgraph.evaluation.coupled_masses import evaluate_coupled_masses
    from pushgraph.evaluation.mass_figures import save_coupled_mass_curves

    models, numbers = {"contact": contact, "belief": belief}, numbers_of(objects, data=data)
    results, scenes = measure(evaluate_coupled_masses, numbers, count, seed, models, workers, data)
    results.save(out / "results.json")
    save_coupled_mass_curves(scenes, out / "coupled.png")
    for number in numbers_measured(results):
        console.print(_coupled_table(scenes, number))
    say_written(out, "coupled.png")


COMMANDS: dict[str, Callable[..., None]] = {
    "masses": masses,
    "controlled-masses": controlled_masses,
    "coupled-masses": coupled_masses,
}


def _cells(values: list[float | None], digits: int = 3) -> list[str]:
    return ["-" if value is None else f"{value:.{digits}f}" for value in values]


def _masses_tables(results: "Results", objects: int) -> list[Table]:
    """One for each of what was observed."""
    from pushgraph.evaluation.masses import INPUTS

    tables = []
    for given in [given for given in INPUTS if any(row["input"] == given for row in results.rows)]:
        title = f"Masses from {given.replace('_', ' ')}, {objects} objects"
        table = Table(title=title, pad_edge=False)
        wanted = [
            *(("mean_abs_error_kg", subset) for subset in ("all", "touched", "pushed")),
            *(("interval_accuracy", subset) for subset in ("touched", "pushed")),
            *(("coverage_68", "all"), ("ece", "all"), ("slide_error", "pushed")),
        ]
        names = ("kg, all", "touched", "pushed", "right, t.", "pushed", "68 %", "ece", "slide")
        table.add_column("frames", justify="right")
        table.add_column("model")
        for name in names:
            table.add_column(name, justify="right")
        table.caption = (
            "kg: mean error; right: likeliest class, of touched and of pushed bodies; slide: relative error of the "
            "force that slides a body, in the median; 95 % intervals over scenes in results.json"
        )
        rows = [row for row in results.rows if (row["objects"], row["input"]) == (objects, given)]
        values = {
            tuple(row[name] for name in ("observed_frames", "model", "metric", "subset")): row["value"]
            for row in rows
            if row["observed_frames"] in (20, 40, 100, "end")
        }
        order = sorted(dict.fromkeys(key[:2] for key in values), key=lambda key: (key[0] == "end", key[0]))
        for observed, some in itertools.groupby(order, key=lambda key: key[0]):
            table.add_section()
            for _, model in some:
                cells = [values.get((observed, model, *one)) for one in wanted]
                table.add_row(str(observed), model.replace("_", " "), *_cells(cells, 2))
        tables.append(table)
    return tables


def _controlled_tables(results: "Results", scenes: Sequence["ControlledScene"], objects: int) -> list[Table]:
    """Numbers, and how many scenes were told how well."""
    from pushgraph.evaluation.controlled_masses import histogram, mix_ups, reference_histogram

    numbers = Table(title=f"Controlled scenes of {objects} objects", pad_edge=False)
    numbers.caption = "95 % intervals over scenes in results.json"
    bars = Table(title=f"Scenes of {objects} objects by how well they were told", pad_edge=False)
    bars.caption = (
        "error: mean of a scene, < 1, 1-2, 2-4, 4-8, > 8 kg; rms: the reference's root mean square, the robot "
        "included, < 0.71, -1.41, -2.83, -5.66, more; mixed up: none, neighbouring classes, light and heavy"
    )
    metrics = ("mean_abs_error_kg", "interval_accuracy", "log_score", "coverage_68", "share_under_1_kg", "ece")
    columns = ("error, kg", "right", "log score", "68 %", "< 1 kg", "ece"), ("error", "rms", "mixed up")
    for table, names in zip((numbers, bars), columns, strict=True):
        for name in ("model", "input", *names):
            table.add_column(name, justify="left" if name in ("model", "input") else "right")
    chosen = [scene for scene in scenes if scene.objects == objects]
    for model, given in chosen[0].answers:
        labels = {"model": model, "input": given, "objects": objects}
        rows = [row for row in results.rows if labels.items() <= row.items()]
        values = {row["metric"]: row["value"] for row in rows}
        name = model.replace("_", " ")
        numbers.add_row(name, given, *_cells([values[metric] for metric in metrics]))
        counts = (count(chosen, model, given).tolist() for count in (histogram, reference_histogram, mix_ups))
        bars.add_row(name, given, *(" ".join(map(str, some)) for some in counts))
    return [numbers, bars]


def _coupled_table(scenes: Sequence["CoupledErrors"], objects: int) -> Table:
    from pushgraph.evaluation.coupled import mean_and_standard_error
    from pushgraph.evaluation.coupled_masses import MODELS, TIMES

    title = f"Rollouts of 50 frames, {objects} objects (mean error ± standard error, cm)"
    table = Table(title=title, pad_edge=False)
    table.add_column("frames", justify="right")
    columns = []
    for model in MODELS:
        table.add_column(model.replace("_", " "), justify="right")
        columns.append(zip(*mean_and_standard_error(scenes, objects, model), strict=True))
    for frames, *cells in zip(TIMES, *columns, strict=True):
        table.add_row(str(frames).replace("_", " "), *(f"{mean:.2f}±{error:.2f}" for mean, error in cells))
    return table
