"""Learning curve of boards in space: the paper's network after more and more interactions, beside the contact solve.

The solve is told masses, frictions and shapes and has learnt nothing, so it is one level line. Every network has the
same budget of samples; killed, the same command goes on.

.venv/bin/python benchmarks/lever_learning.py --data lever-up.h5 --validation lever-up-validation.h5
"""

import time
from pathlib import Path
from typing import Annotated

import typer
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table

from pushgraph.evaluation.lever_up import NOISE_FLOOR, evaluate_lever_up
from pushgraph.training.lever import LeverTraining, train_lever
from pushgraph.training.run import TrainingRun

NETWORK, SOLVE = "network", "solve"
METRICS = {"final_position_error_mm": "final position (mm)", "final_rotation_error_deg": "final rotation (degrees)"}
LEVELS = {"still": "#bbbbbb", "rigid": "#c04040", SOLVE: "#2060c0", NOISE_FLOOR: "#40a060"}


def main(
    data: Annotated[Path, typer.Option(help="Training data; the first interactions of it are used.")],
    validation: Annotated[Path, typer.Option(help="Interactions on which the weights are chosen.")],
    sizes: Annotated[list[int], typer.Option(help="Interactions; repeat it.")] = [31, 62, 125, 250, 500],  # noqa: B006
    samples: Annotated[int, typer.Option(help="Predicted frames of training windows, each network.")] = 100_000,
    count: Annotated[int, typer.Option(help="Test drives.")] = 24,
    seed: Annotated[int, typer.Option(help="Of the test drives.")] = 1_000_000,
    out: Annotated[Path, typer.Option(help="Folder for results, figure and weights.")] = Path("lever_learning"),
) -> None:
    console, models = Console(), {SOLVE: "lever_up"}
    for size in sizes:
        training = LeverTraining(
            model="lever_up_propnet", data=str(data), validation=str(validation), samples=samples, interactions=size
        )
        path = out / f"{size}.safetensors"
        if not path.is_file():
            begun = time.monotonic()
            train_lever(training, TrainingRun(out=str(path)))
            console.print(f"{size} interactions: trained in {time.monotonic() - begun:.0f} s")
        models[f"{NETWORK} {size}"] = str(path)
    results, cases = evaluate_lever_up(count, seed, models)
    results.save(out / "results.json")
    rows = {
        (row["model"], row["metric"]): row
        for row in results.rows
        if (row["subset"], row["side"], row["ledge"]) == ("raised", "all", "all")
    }
    raised = sum(case.raised for case in cases)
    table = Table(title=f"Medians on {raised} raised boards of {len(cases)}, {samples:,} samples a network")
    for name in ("", *METRICS.values()):
        table.add_column(name, justify="right" if name else "left")
    for model in ("still", "rigid", *(f"{NETWORK} {size}" for size in sizes), SOLVE, NOISE_FLOOR):
        table.add_row(model.replace("_", " "), *(f"{rows[model, metric]['value']:.2f}" for metric in METRICS))
    console.print(table)
    figure = Figure(figsize=(9, 3.6), layout="constrained")
    for axes, (metric, label) in zip(figure.subplots(1, 2), METRICS.items(), strict=True):
        draw(axes, {model: row for (model, name), row in rows.items() if name == metric}, sizes, label)
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=5, frameon=False)
    figure.savefig(out / "lever_learning.png", dpi=110)
    console.print(f"Written: {out / 'results.json'}, {out / 'lever_learning.png'}")


def draw(axes: Axes, rows: dict[str, dict], sizes: list[int], label: str) -> None:
    """One panel: errors of the networks over interactions, and what does not learn as level lines."""
    chosen = [rows[f"{NETWORK} {size}"] for size in sizes]
    values = [row["value"] for row in chosen]
    around = [[row["value"] - row["low"] for row in chosen], [row["high"] - row["value"] for row in chosen]]
    axes.errorbar(sizes, values, yerr=around, marker=".", color="#d08000", capsize=3, label="network (learnt)")
    for model, colour in LEVELS.items():
        axes.axhline(rows[model]["value"], color=colour, ls="--", label=model.replace("_", " "))
    axes.set(xlabel="interactions", ylabel=label, xscale="log", yscale="log", xticks=sizes, xticklabels=sizes)
    axes.minorticks_off()
    axes.grid(alpha=0.3)


if __name__ == "__main__":
    typer.run(main)
