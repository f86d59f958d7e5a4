"""The commands of `pushgraph evaluate` that measure the networks for joints and motion."""

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from pushgraph.cli.output import console
from pushgraph.cli.own_suites import SuiteGroup
from pushgraph.cli.suites import (
    CORES,
    DRAWN,
    Belief,
    Contact,
    Count,
    Data,
    Models,
    Objects,
    Out,
    Seed,
    Setup,
    Workers,
    measure,
    models_of,
    numbers_measured,
    numbers_of,
    say_written,
)

if TYPE_CHECKING:
    from pushgraph.evaluation.coupled import CoupledErrors
    from pushgraph.evaluation.results import Results

app = typer.Typer(cls=SuiteGroup, help="Measure the shipped networks, or your own.", no_args_is_help=True)


@app.callback()
def evaluate() -> None:
    """Measure the shipped networks, or your own."""


@app.command("physics")
def physics(
    count: Count = None,
    seed: Seed = 1_000_000,
    out: Out = Path("evaluation-physics"),
    objects: Objects = None,
    setup: Setup = DRAWN,
    data: Data = None,
    model: Models = None,
    workers: Workers = CORES,
) -> None:
    """Roll out `contact`, `propnet`, `image` or your own against simulation, beside standing still and the noise floor.

    Examples:

    `pushgraph evaluate physics --count 1000 --objects 9 --out result`

    `pushgraph evaluate physics --model contact --model mine=my.safetensors --data my.h5`
    """
    from pushgraph.evaluation.figures import save_histogram
    from pushgraph.evaluation.physics import evaluate_physics

    models = models_of(model, ("image", "propnet", "contact"), ("still", "noise_floor"))
    numbers = numbers_of(objects, setup, data)
    results, scenes = measure(evaluate_physics, numbers, count, seed, models, workers, data, setup=setup)
    results.save(out / "results.json")
    save_histogram(scenes, ("still", *models, "noise_floor"), out / "histogram.png")
    for number in numbers_measured(results):
        console.print(_physics_table(results, number))
    say_written(out, "histogram.png")


@app.command("belief")
def belief(
    count: Count = None,
    seed: Seed = 1_000_000,
    out: Out = Path("evaluation-belief"),
    objects: Objects = None,
    setup: Setup = DRAWN,
    data: Data = None,
    model: Models = None,
    workers: Workers = CORES,
) -> None:
    """Watch test scenes with `belief`, `paper_recipe` or your own, and score what they say is joined, beside perfect
    inference.

    Examples:

    `pushgraph evaluate belief --count 500 --objects 9 --out result`

    `pushgraph evaluate belief --setup jointed --model belief --model mine=my.safetensors`
    """
    from pushgraph.evaluation.belief import INFORMED, evaluate_belief
    from pushgraph.evaluation.figures import save_belief_curves, save_reliability

    models = models_of(model, ("belief", "paper_recipe"), (INFORMED,))
    numbers = numbers_of(objects, setup, data)
    results, scenes = measure(evaluate_belief, numbers, count, seed, models, workers, data, setup=setup)
    results.save(out / "results.json")
    save_belief_curves(results.rows, out / "curves.png")
    save_reliability(scenes, tuple(models), out / "reliability.png")
    for number in numbers_measured(results):
        console.print(_belief_table(results, number))
    say_written(out, "curves.png", "reliability.png")


@app.command("coupled")
def coupled(
    count: Count = None,
    seed: Seed = 1_000_000,
    out: Out = Path("evaluation-coupled"),
    objects: Objects = None,
    data: Data = None,
    contact: Contact = "contact",
    belief: Belief = "belief",
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
    results, scenes = measure(evaluate_coupled, numbers_of(objects, data=data), count, seed, models, workers, data)
    results.save(out / "results.json")
    save_coupled_curves(scenes, out / "coupled.png")
    for number in numbers_measured(results):
        console.print(_coupled_table(scenes, number))
    say_written(out, "coupled.png")


@app.command("spread")
def spread(
    count: Count = None,
    seed: Seed = 1_000_000,
    out: Out = Path("evaluation-spread"),
    objects: Objects = None,
    data: Data = None,
    contact: Contact = "contact",
    spread: Annotated[str, typer.Option(help="Checkpoint that says how surely.")] = "spread",
    belief: Belief = "belief",
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
    results, scenes = measure(evaluate_spread, numbers_of(objects, data=data), count, seed, models, workers, data)
    results.save(out / "results.json")
    save_coverage(scenes, out / "coverage.png")
    for number in numbers_measured(results):
        console.print(_spread_table(results, number))
    say_written(out, "coverage.png")


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
            knowledge = f"believed, {observed}" if joints == "believed" else joints
            cells = ("-" if v is None else f"{v:.3f}" for v in numbers)
            table.add_row(knowledge, masses, str(key[3]), *cells)
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
