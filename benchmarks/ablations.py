"""Why the engine is as it is: what prediction loses without its parts, and what a network without them gains by size.

Networks that learn have the same data and budget each; the contact solve has learnt nothing, so its variants need no
training. Killed, the same command goes on; one variant by name: `--variant messages-2`.

.venv/bin/python benchmarks/ablations.py --data parts.h5 --validation validation.h5 --out ablations
"""

import dataclasses
from pathlib import Path
from typing import Annotated, Any, NamedTuple

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
from pushgraph.graph.contact_graph import contact_graph
from pushgraph.graph.pieces import gather_pieces, piece_index
from pushgraph.graph.propnet_graph import DISPLACEMENT
from pushgraph.graph.scene_batch import Relations, pairs_of
from pushgraph.graph.state import Control, State
from pushgraph.network.contact_network import ContactNetwork
from pushgraph.network.contract import Advance
from pushgraph.network.dynamics import ContactDynamics, PropnetDynamics
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


class WithoutVelocity(PropnetDynamics):
    """The paper's network, which is not told how bodies moved in the frame before."""

    def forward(self, state: State, control: Control) -> Advance:
        state = state._replace(motions=torch.zeros_like(state.motions))
        return super().forward(state, control._replace(last_motion=torch.zeros_like(control.last_motion)))


class HeldPieces(PropnetDynamics):
    """The paper's network, and what fixed joints join moves as one piece, with its members' mean."""

    def _motion(self, state: State, graph: Any, motion: Tensor) -> Tensor:
        pieces = gather_pieces(state.scenes, piece_index(state.scenes, state.relations), state.poses)
        return super()._motion(state, graph._replace(pieces=pieces), motion)


class ContactMessages(ContactDynamics):
    """Contact geometry without the solve: messages between contacts, which answer with motion instead of forces."""

    CHAOS = 10.0
    FRAMES_PER_STEP = (1,)

    def __init__(self, hidden: int = 128, steps: int = 5) -> None:
        super().__init__(hidden, steps)
        self.network = ContactNetwork(hidden, steps)
        self.answer = nn.Linear(hidden, 3)

    @staticmethod
    def error_unit(step: Float[Tensor, " batch"]) -> Float[Tensor, " batch"]:
        return torch.full_like(step, DISPLACEMENT)

    def forward(self, state: State, control: Control) -> Advance:
        graph = contact_graph(state, control)
        seen = contact_features(state, graph)
        hidden, _ = self.network.propagate(seen)
        answers = (self.answer(hidden[0]) * seen.weight[:, None]).to(state.poses)
        edge = torch.cat((graph.contacts.points.edge, graph.joints.points.edge))
        normal = graph.edges.normal[:, edge]
        normal = torch.cat((normal, -normal), 1)
        along, across, turn = answers.unbind(-1)
        x = along * normal[0] - across * normal[1]
        y = along * normal[1] + across * normal[0]
        own = torch.stack((x, y, turn)).to(graph.nodes.last_twist)
        twist = torch.zeros_like(graph.nodes.last_twist).index_add(1, seen.receiver, own)
        return Advance(self._motion(state, graph, twist), torch.ones_like(state.poses[:, 0, 0]))


class WithoutMemory(ContactDynamics):
    """The contact solve that finds joints anew in every frame: where the two bodies are closest now."""

    def forward(self, state: State, control: Control) -> Advance:
        return super().forward(state._replace(relations=_found_now(state)), control)


class NotHeld(ContactDynamics):
    """The contact solve that forgives hinges what they have drifted, in every frame."""

    def forward(self, state: State, control: Control) -> Advance:
        relations, (pose_a, pose_b) = state.relations, _ends(state)
        anchor = pose.transform(pose_a, relations.anchor_a.to(pose_a))
        anchor_b = pose.transform(pose.inverse(pose_b), anchor).to(relations.anchor_b)
        slides = relations.kind == 2
        relations = relations._replace(anchor_b=torch.where(slides[..., None], relations.anchor_b, anchor_b))
        return super().forward(state._replace(relations=relations), control)


class NoJoints(ContactDynamics):
    """The contact solve of bodies that nothing joins."""

    def forward(self, state: State, control: Control) -> Advance:
        relations = state.relations._replace(kind=torch.zeros_like(state.relations.kind))
        return super().forward(state._replace(relations=relations), control)


def _ends(state: State) -> tuple[Tensor, Tensor]:
    a, b = pairs_of(state.poses.shape[1], state.poses.device)
    return state.poses[:, a], state.poses[:, b]


def _found_now(state: State) -> Relations:
    a, b = pairs_of(state.poses.shape[1], state.poses.device)
    pose_a, pose_b = _ends(state)
    boxes = state.scenes.boxes
    ends = (RoundedBox(*(values[:, end].double() for values in boxes)) for end in (a, b))
    middle = contact_between(*ends, pose.relative(pose_a, pose_b).double()).middle.to(pose_a)
    anchor_b = pose.transform(pose.inverse(pose_b), pose.transform(pose_a, middle))
    old = state.relations
    return old._replace(
        anchor_a=middle.to(old.anchor_a),
        anchor_b=anchor_b.to(old.anchor_b),
        yaw_offset=(pose_b[..., 2] - pose_a[..., 2]).to(old.yaw_offset),
    )


for name, network in {
    "without_velocity": WithoutVelocity,
    "held_pieces": HeldPieces,
    "contact_messages": ContactMessages,
    "without_memory": WithoutMemory,
    "not_held": NotHeld,
    "no_joints": NoJoints,
}.items():
    register_network(name, network)


class Variant(NamedTuple):
    """model: as registered. settings: of its training, beside the common ones; None: the solve's weights are taken."""

    model: str
    settings: dict[str, int] | None


VARIANTS = {
    "solve": Variant("contact", None),
    "solve-without-memory": Variant("without_memory", None),
    "solve-not-held": Variant("not_held", None),
    "solve-no-joints": Variant("no_joints", None),
    "contact-messages": Variant("contact_messages", {}),
    "messages": Variant("propnet", {}),
    "messages-without-velocity": Variant("without_velocity", {}),
    "messages-held-pieces": Variant("held_pieces", {}),
    **{f"messages-{steps}-steps": Variant("propnet", {"propagation_steps": steps}) for steps in (1, 2, 4, 6, 8)},
    **{f"messages-hidden-{hidden}": Variant("propnet", {"hidden": hidden}) for hidden in (64, 256)},
    "messages-1-frame": Variant("propnet", {"frames": 1, "batch": 256}),
    "messages-10-frames": Variant("propnet", {"frames": 10, "batch": 26}),
}
"""`messages` is the paper's network of 5 steps, width 128, and 4 frames in a row."""


def main(
    data: Annotated[Path, typer.Option(help="Training data.")],
    validation: Annotated[Path, typer.Option(help="Scenes on which weights are chosen.")],
    variant: Annotated[list[str] | None, typer.Option(help="Of these only; repeat it.")] = None,
    samples: Annotated[int, typer.Option(help="Predicted frames of training windows, each network.")] = 100_000,
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
            _make(VARIANTS[name], data, validation, samples, Path(path))
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
        table.add_row(model.replace("_", " "), *(f"{rows[model, metric]['value']:.2f}" for metric in METRICS))
    console.print(table)
    _save_figure(rows, shown, out / "ablations.png")


def _make(variant: Variant, data: Path, validation: Path, samples: int, path: Path) -> None:
    if variant.settings is None:
        solve = load_checkpoint(shipped("contact"))
        save_checkpoint(dataclasses.replace(solve, kind=variant.model), path)
        return
    common = {"frames": 4, "batch": 64, "hidden": 128, "propagation_steps": 5, "learning_rate": 1e-3}
    settings: dict[str, Any] = common | variant.settings
    training = PhysicsTraining(
        model=variant.model, data=str(data), validation=str(validation), samples=samples, **settings
    )
    train_physics(training, TrainingRun(out=str(path)))


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
