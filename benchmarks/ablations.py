"""Why the engine is as it is: what prediction loses without its parts, and what the size of a network is worth.

Networks that learn have the same data and budget each; the contact solve has learnt nothing, so its variants need no
training. Killed, the same command goes on; one variant by name: `--variant messages-2-steps`.

.venv/bin/python benchmarks/ablations.py --data parts.h5 --validation validation.h5 --out ablations
"""

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, ClassVar, NamedTuple

import torch
import typer
from jaxtyping import Float
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table
from torch import Tensor, nn

from pushgraph import pose
from pushgraph.checkpoint import load_checkpoint, save_checkpoint, shipped
from pushgraph.contact import RoundedBox, contact_between
from pushgraph.evaluation.physics import evaluate_physics
from pushgraph.graph.contact_features import contact_features
from pushgraph.graph.contact_graph import ContactGraph, contact_graph
from pushgraph.graph.propnet_graph import DISPLACEMENT
from pushgraph.graph.scene_batch import JOINT_CODES, pairs_of
from pushgraph.graph.state import Control, State
from pushgraph.network.contact_network import ContactNetwork
from pushgraph.network.contact_problem import ContactProblem
from pushgraph.network.contract import Advance
from pushgraph.network.dynamics import ContactDynamics, PropnetDynamics
from pushgraph.network.newton import solve
from pushgraph.network.registry import register_network
from pushgraph.training.physics import train_physics
from pushgraph.training.recipe import PhysicsTraining
from pushgraph.training.run import TrainingRun

METRICS = {
    "mean_error_cm": "mean error",
    "final_error_moved_cm": "final, moved",
    "median_final_error_moved_cm": "median of that",
}
FRAMES = 50


class ContactMessages(ContactDynamics):
    """Contact geometry without the solve: messages between contacts, which answer with motion instead of forces."""

    CHAOS = 10.0
    FRAMES_PER_STEP = (1,)

    def __init__(self, hidden: int = 128, steps: int = 4) -> None:
        super().__init__(hidden, steps)
        self.network = ContactNetwork(hidden, steps)
        self.answer = nn.Linear(hidden, 3)
        nn.init.zeros_(self.answer.weight)
        nn.init.zeros_(self.answer.bias)

    @staticmethod
    def error_unit(step: Float[Tensor, " batch"]) -> Float[Tensor, " batch"]:
        return torch.full_like(step, DISPLACEMENT)

    def forward(self, state: State, control: Control) -> Advance:
        graph = contact_graph(state, control)
        seen = contact_features(state, graph)
        answers = self.answer(self.network.propagate(seen)[0]) * seen.weight[:, None]
        # A mirror turns round what is across a normal, and turns.
        even, odd = (answers[0] + answers[1]) / 2, (answers[0] - answers[1]) / 2
        along, across, turn = even[:, 0], odd[:, 1], odd[:, 2]
        normal = graph.edges.normal[:, torch.cat((graph.contacts.points.edge, graph.joints.points.edge))]
        n_x, n_y = torch.cat((normal, -normal), 1)
        own = torch.stack((along * n_x - across * n_y, along * n_y + across * n_x, turn))
        twist = torch.zeros_like(graph.nodes.last_twist).index_add(1, seen.receiver, own.to(graph.nodes.last_twist))
        return Advance(self._motion(state, graph, twist), torch.ones_like(state.poses[:, 0, 0]))


class JointsHeld(ContactMessages):
    """The same, projected to the nearest motion that hinges and sliders allow; distance is counted by mass."""

    def _motion(self, state: State, graph: ContactGraph, twist: Tensor) -> Tensor:
        nodes, problem = graph.nodes, ContactProblem.of(graph)
        problem = problem._replace(
            last=torch.where(nodes.given, problem.last, twist),
            inertia=torch.stack((nodes.mass, nodes.mass, nodes.mass * nodes.gyration)),
            feet=problem.feet._replace(weight=torch.zeros_like(problem.feet.weight)),
            stiffness=torch.zeros_like(problem.stiffness),
        )
        return super()._motion(state, graph, solve(problem))


def seeing(base: type[ContactDynamics], change: Callable[[State], State]) -> type[ContactDynamics]:
    """The same network, which sees changed states."""

    class Seeing(base):
        def forward(self, state: State, control: Control) -> Advance:
            return super().forward(change(state), control)

    return Seeing


def no_velocity(state: State) -> State:
    """How bodies moved in the frame before is not told."""
    return state._replace(motions=torch.zeros_like(state.motions))


def no_joints(state: State) -> State:
    """Nothing is joined."""
    return state._replace(relations=state.relations._replace(kind=torch.zeros_like(state.relations.kind)))


def fixed_as_sliders(state: State) -> State:
    """Fixed joints are sliders without room to slide, so that what they join moves as two pieces."""
    old = state.relations
    fixed = (old.kind == JOINT_CODES["fixed"])[..., None]
    return state._replace(
        relations=old._replace(
            kind=torch.where(fixed[..., 0], JOINT_CODES["prismatic"], old.kind),
            axis=torch.where(fixed, old.axis.new_tensor([1.0, 0.0]), old.axis),
            limits=torch.where(fixed, 0.0, old.limits),
        )
    )


def found_anew(state: State) -> State:
    """Joints are where the two bodies are closest now."""
    old, (a, b) = state.relations, pairs_of(state.poses.shape[1], state.poses.device)
    pose_a, pose_b = state.poses[:, a], state.poses[:, b]
    ends = (RoundedBox(*(values[:, end].double() for values in state.scenes.boxes)) for end in (a, b))
    middle = contact_between(*ends, pose.relative(pose_a, pose_b).double()).middle.to(pose_a)
    anchor_b = pose.transform(pose.inverse(pose_b), pose.transform(pose_a, middle))
    return state._replace(
        relations=old._replace(
            anchor_a=middle.to(old.anchor_a),
            anchor_b=anchor_b.to(old.anchor_b),
            yaw_offset=(pose_b[..., 2] - pose_a[..., 2]).to(old.yaw_offset),
        )
    )


def drift_forgiven(state: State) -> State:
    """Hinges turn about where the anchor of their first body is now."""
    old, (a, b) = state.relations, pairs_of(state.poses.shape[1], state.poses.device)
    pose_a, pose_b = state.poses[:, a], state.poses[:, b]
    anchor = pose.transform(pose.inverse(pose_b), pose.transform(pose_a, old.anchor_a.to(pose_a)))
    hinge = (old.kind == JOINT_CODES["revolute"])[..., None]
    return state._replace(relations=old._replace(anchor_b=torch.where(hinge, anchor.to(old.anchor_b), old.anchor_b)))


class Variant(NamedTuple):
    """settings: of its training, where they are not the common ones; None: nothing is trained."""

    network: type[ContactDynamics | PropnetDynamics]
    settings: dict[str, int] | None


COMMON = {"frames": 4, "batch": 32, "hidden": 128, "propagation_steps": 4, "learning_rate": 1e-3}
VARIANTS = {
    "solve": Variant(ContactDynamics, None),
    "solve-joints-found-anew": Variant(seeing(ContactDynamics, found_anew), None),
    "solve-drift-forgiven": Variant(seeing(ContactDynamics, drift_forgiven), None),
    "solve-no-joints": Variant(seeing(ContactDynamics, no_joints), None),
    "messages": Variant(ContactMessages, {}),
    "messages-other-seed": Variant(ContactMessages, {"seed": 1}),
    "messages-between-centres": Variant(PropnetDynamics, {}),
    "messages-joints-found-anew": Variant(seeing(ContactMessages, found_anew), {}),
    "messages-joints-held": Variant(JointsHeld, {}),
    "messages-fixed-as-sliders": Variant(seeing(ContactMessages, fixed_as_sliders), {}),
    "messages-no-velocity": Variant(seeing(ContactMessages, no_velocity), {}),
    **{f"messages-{steps}-steps": Variant(ContactMessages, {"propagation_steps": steps}) for steps in (1, 2, 6, 8)},
    **{f"messages-hidden-{hidden}": Variant(ContactMessages, {"hidden": hidden}) for hidden in (64, 256)},
    "messages-1-frame": Variant(ContactMessages, {"frames": 1, "batch": 128}),
    "messages-10-frames": Variant(ContactMessages, {"frames": 10, "batch": 13}),
}
for name, variant in VARIANTS.items():
    register_network(name, variant.network)


class Training(PhysicsTraining):
    """Few validations: they are long beside so few samples."""

    VALIDATIONS: ClassVar[int] = 4


def main(
    data: Annotated[Path, typer.Option(help="Training data.")],
    validation: Annotated[Path, typer.Option(help="Scenes on which weights are chosen.")],
    variant: Annotated[list[str] | None, typer.Option(help="Of these only; repeat it.")] = None,
    samples: Annotated[int, typer.Option(help="Predicted frames of training windows, each network.")] = 150_000,
    count: Annotated[int, typer.Option(help="Test scenes of nine objects.")] = 60,
    seed: Annotated[int, typer.Option(help="Of the test scenes.")] = 1_000_000,
    out: Annotated[Path, typer.Option(help="Folder for results, figure and weights.")] = Path("ablations"),
) -> None:
    console = Console()
    models = {}
    for name in variant or VARIANTS:
        path = models[name] = str(out / f"{name}.safetensors")
        if not Path(path).is_file():
            console.print(name)
            _make(name, data, validation, samples, Path(path))
    results, _ = evaluate_physics([9], count, seed, models)
    results.save(out / "results.json")
    rows = {
        (row["model"], row["metric"]): row
        for row in results.rows
        if (row["frames"], row["density"]) == (FRAMES, "all")
    }
    shown = ("still", *models, "noise_floor")
    table = Table(title=f"{count} scenes of nine objects, {FRAMES} frames (cm), {samples:,} samples a network")
    for title in ("", *METRICS.values()):
        table.add_column(title, justify="right" if title else "left")
    for model in shown:
        table.add_row(model.replace("_", " "), *(_written(rows[model, metric]) for metric in METRICS))
    console.print(table)
    _save_figure(rows, shown, out / "ablations.png")


def _make(name: str, data: Path, validation: Path, samples: int, path: Path) -> None:
    settings = VARIANTS[name].settings
    if settings is None:
        save_checkpoint(dataclasses.replace(load_checkpoint(shipped("contact")), kind=name), path)
        return
    recipe: dict[str, Any] = COMMON | settings
    training = Training(model=name, data=str(data), validation=str(validation), samples=samples, **recipe)
    train_physics(training, TrainingRun(out=str(path)))


def _written(row: dict[str, Any]) -> str:
    return f"{row['value']:.2f} ({row['low']:.2f} to {row['high']:.2f})"


def _save_figure(rows: dict[tuple[str, str], dict[str, Any]], shown: tuple[str, ...], path: Path) -> None:
    figure = Figure(figsize=(8, 0.3 * len(shown) + 1), layout="constrained")
    axes = figure.subplots()
    found = [rows[model, "final_error_moved_cm"] for model in shown]
    value = [row["value"] for row in found]
    spread = [[row["value"] - row["low"] for row in found], [row["high"] - row["value"] for row in found]]
    axes.barh(range(len(shown)), value, xerr=spread, color="#2060c0")
    axes.set_yticks(range(len(shown)), [model.replace("_", " ") for model in shown])
    axes.invert_yaxis()
    axes.set(xscale="log", xlabel=f"final error of bodies that moved, {FRAMES} frames (cm)")
    figure.savefig(path)


if __name__ == "__main__":
    typer.run(main)
