"""Why the engine is as it is: what prediction loses without its parts, and what the size of a network is worth.

Networks that learn have the same data and budget each; the contact solve has learnt nothing, so its variants need no
training. Killed, the same command goes on; one variant by name: `--variant messages-2-steps`.

.venv/bin/python benchmarks/ablations.py --data parts.h5 --validation validation.h5 --out ablations
"""

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np
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

BASE = "messages"
"""What the variants that learn are compared with, body by body."""
METRICS = {
    "mean_error_cm": "mean error",
    "final_error_moved_cm": "final, moved",
    "median_final_error_moved_cm": "median of that",
    "above_base_cm": f"final, moved, above {BASE}",
}
FRAMES = 50
MOST = (0.05, 0.05, 1.0)
"""No learnt motion is larger in a frame (m, m, rad); tools move by 0.025 m at most."""


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


class ExactVelocities(PropnetDynamics):
    """The paper's network, trained on velocities without noise."""

    VELOCITY_NOISE = 0.0


Dynamics = type[ContactDynamics | PropnetDynamics]


def seeing(base: Dynamics, change: Callable[[State], State]) -> Dynamics:
    """The same network, which sees changed states."""

    class Seeing(base):
        def forward(self, state: State, control: Control) -> Advance:
            return super().forward(change(state), control)

    return Seeing


def bounded(base: Dynamics) -> Dynamics:
    """The same network, whose rollouts stay finite where they diverge."""

    class Bounded(base):
        def forward(self, state: State, control: Control) -> Advance:
            advance = super().forward(state, control)
            most = advance.motion.new_tensor(MOST)
            return advance._replace(motion=advance.motion.clamp(-most, most))

    return Bounded


def no_velocity(state: State) -> State:
    """How bodies moved in the frame before is not told."""
    return state._replace(motions=torch.zeros_like(state.motions))


def no_joints(state: State) -> State:
    """Nothing is joined."""
    return _joined(state, kind=torch.zeros_like(state.relations.kind))


def fixed_as_sliders(state: State) -> State:
    """Fixed joints are sliders without room to slide, so that what they join moves as two pieces."""
    old = state.relations
    fixed = old.kind == JOINT_CODES["fixed"]
    return _joined(
        state,
        kind=torch.where(fixed, JOINT_CODES["prismatic"], old.kind),
        axis=torch.where(fixed[..., None], old.axis.new_tensor([1.0, 0.0]), old.axis),
        limits=torch.where(fixed[..., None], 0.0, old.limits),
    )


def found_anew(state: State) -> State:
    """Joints are where the two bodies are closest now."""
    a, b = pairs_of(state.poses.shape[1], state.poses.device)
    pose_a, pose_b = state.poses[:, a], state.poses[:, b]
    ends = (RoundedBox(*(values[:, end].double() for values in state.scenes.boxes)) for end in (a, b))
    middle = contact_between(*ends, pose.relative(pose_a, pose_b).double()).middle.to(pose_a)
    anchor_b = pose.transform(pose.inverse(pose_b), pose.transform(pose_a, middle))
    return _joined(state, anchor_a=middle, anchor_b=anchor_b, yaw_offset=pose_b[..., 2] - pose_a[..., 2])


def drift_forgiven(state: State) -> State:
    """Hinges turn about where the anchor of their first body is now."""
    old, (a, b) = state.relations, pairs_of(state.poses.shape[1], state.poses.device)
    anchor = pose.transform(state.poses[:, a], old.anchor_a.to(state.poses))
    anchor = pose.transform(pose.inverse(state.poses[:, b]), anchor)
    hinge = (old.kind == JOINT_CODES["revolute"])[..., None]
    return _joined(state, anchor_b=torch.where(hinge, anchor.to(old.anchor_b), old.anchor_b))


def _joined(state: State, **changes: Tensor) -> State:
    old = state.relations
    changes = {name: values.to(getattr(old, name)) for name, values in changes.items()}
    return state._replace(relations=old._replace(**changes))


class Variant(NamedTuple):
    """settings: of its training, where they are not the common ones; None: nothing is trained."""

    network: Dynamics
    settings: dict[str, int] | None


UNTOLD = seeing(ContactMessages, no_velocity)
COMMON = {"frames": 4, "batch": 32, "hidden": 128, "propagation_steps": 4, "learning_rate": 1e-3}
VARIANTS = {
    "solve": Variant(ContactDynamics, None),
    "solve-joints-found-anew": Variant(seeing(ContactDynamics, found_anew), None),
    "solve-drift-forgiven": Variant(seeing(ContactDynamics, drift_forgiven), None),
    "solve-no-joints": Variant(seeing(ContactDynamics, no_joints), None),
    "messages": Variant(ContactMessages, {}),
    "messages-other-seed": Variant(ContactMessages, {"seed": 1}),
    "messages-between-centres": Variant(PropnetDynamics, {}),
    "messages-between-centres-exact-velocity": Variant(ExactVelocities, {}),
    "messages-between-centres-no-velocity": Variant(seeing(ExactVelocities, no_velocity), {}),
    "messages-joints-found-anew": Variant(seeing(ContactMessages, found_anew), {}),
    "messages-joints-held": Variant(JointsHeld, {}),
    "messages-fixed-as-sliders": Variant(seeing(ContactMessages, fixed_as_sliders), {}),
    "messages-no-velocity": Variant(UNTOLD, {}),
    "messages-no-velocity-1-step": Variant(UNTOLD, {"propagation_steps": 1}),
    **{f"messages-{steps}-steps": Variant(ContactMessages, {"propagation_steps": steps}) for steps in (1, 2, 6, 8)},
    **{f"messages-hidden-{hidden}": Variant(ContactMessages, {"hidden": hidden}) for hidden in (64, 256)},
    "messages-1-frame": Variant(ContactMessages, {"frames": 1, "batch": 128}),
    "messages-10-frames": Variant(ContactMessages, {"frames": 10, "batch": 13}),
}
for name, variant in VARIANTS.items():
    register_network(name, variant.network if variant.settings is None else bounded(variant.network))


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
    console = Console(width=120)
    models = {}
    for name in variant or VARIANTS:
        models[name] = str(out / f"{name}.safetensors")
        console.print(name)
        _make(name, data, validation, samples, Path(models[name]))
    results, scenes = evaluate_physics([9], count, seed, models)
    for model in models if BASE in models else ():
        of_scenes = [(scene.errors[model, FRAMES], scene.errors[BASE, FRAMES]) for scene in scenes]
        above = [100 * (error.final - base.final)[base.moved] for error, base in of_scenes]
        owner = np.repeat(np.arange(len(above)), [len(values) for values in above])
        above = np.concatenate(above)
        results.add(model, "above_base_cm", "cm", above, owner, objects=9, frames=FRAMES, density="all")
    results.save(out / "results.json")
    some = [row for row in results.rows if (row["frames"], row["density"]) == (FRAMES, "all")]
    rows = {(row["model"], row["metric"]): row for row in some}
    shown = ("still", *models, "noise_floor")
    table = Table(title=f"{count} scenes of nine objects, {FRAMES} frames (cm), 95 % intervals over scenes")
    for title in ("", *METRICS.values()):
        table.add_column(title, justify="right" if title else "left")
    for model in shown:
        table.add_row(_title(model), *(_written(rows.get((model, metric))) for metric in METRICS))
    console.print(table)
    _save_figure([(_title(model), rows[model, "final_error_moved_cm"]) for model in shown], out / "ablations.png")


def _make(name: str, data: Path, validation: Path, samples: int, path: Path) -> None:
    """Train a variant, if that was not done; the solve's take its shipped checkpoint."""
    settings = VARIANTS[name].settings
    if settings is None:
        save_checkpoint(dataclasses.replace(load_checkpoint(shipped("contact")), kind=name), path)
    elif not path.is_file():
        recipe: dict[str, Any] = COMMON | settings
        training = Training(model=name, data=str(data), validation=str(validation), samples=samples, **recipe)
        train_physics(training, TrainingRun(out=str(path)))


def _title(model: str) -> str:
    return model.replace("-", " ").replace("_", " ")


def _written(row: dict[str, Any] | None) -> str:
    return f"{row['value']:.2f} ({row['low']:.2f} to {row['high']:.2f})" if row else ""


def _save_figure(rows: list[tuple[str, dict[str, Any]]], path: Path) -> None:
    figure = Figure(figsize=(8, 0.3 * len(rows) + 1), layout="constrained")
    axes = figure.subplots()
    for place, (title, row) in enumerate(rows):
        axes.plot((row["low"], row["high"]), (place, place), color="#90b0e0", linewidth=4)
        axes.plot(row["value"], place, "o", color="#2060c0")
        if title == BASE:
            axes.axvline(row["value"], color="#808080", linewidth=0.8)
    axes.set_yticks(range(len(rows)), [title for title, _ in rows])
    axes.invert_yaxis()
    axes.grid(axis="x", color="#e0e0e0")
    axes.set(xscale="log", xlabel=f"final error of bodies that moved, {FRAMES} frames (cm)")
    axes.xaxis.set_major_formatter("{x:g}")
    figure.savefig(path)


if __name__ == "__main__":
    typer.run(main)
