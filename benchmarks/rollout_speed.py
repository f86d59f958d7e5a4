"""Speed of rollouts and of training, beside the paper's dense formulation and MuJoCo, on one thread in the same run.

.venv/bin/python benchmarks/rollout_speed.py --scenes 256 --out rollout_speed
"""

import contextlib
import itertools
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import numpy as np
import torch
import typer
from rich.console import Console
from rich.table import Table
from torch import nn

from pushgraph.evaluation.metrics import MOVED
from pushgraph.graph.propnet_graph import EDGE_FEATURES, NODE_FEATURES
from pushgraph.graph.scene_batch import batch_scenes
from pushgraph.graph.state import State, controls
from pushgraph.physics import PhysicsPredictor
from pushgraph.precision import PRECISIONS
from pushgraph.simulation.aiming import aim
from pushgraph.simulation.placement import NoRoom
from pushgraph.simulation.planar import PlanarSimulation
from pushgraph.simulation.setups import ATTEMPTS, draw_trajectory, multiple_parts
from pushgraph.track import Track

FRAMES = 30
REPEATS = 3
SINGLES = 12
"""So many scenes are predicted one by one."""


class DensePropagationNetwork(nn.Module):
    """The reference code's formulation: one-hot matrices over all ordered pairs of nodes, hidden 256, five steps."""

    def __init__(self, hidden: int = 256, steps: int = 5) -> None:
        super().__init__()
        self.steps = steps

        def mlp(*widths: int) -> nn.Sequential:
            layers = (m for a, b in itertools.pairwise(widths) for m in (nn.Linear(a, b), nn.ReLU()))
            return nn.Sequential(*layers)

        self.object_encoder = mlp(len(NODE_FEATURES), hidden, hidden)
        self.relation_encoder = mlp(len(EDGE_FEATURES), hidden, hidden, hidden)
        self.relation_propagator = mlp(3 * hidden, hidden)
        self.object_propagator = nn.Linear(2 * hidden, hidden)
        self.head = nn.Sequential(nn.Linear(hidden, hidden), nn.ReLU(), nn.Linear(hidden, 3))

    def forward(self, nodes: torch.Tensor, edges: torch.Tensor, receivers: torch.Tensor, senders: torch.Tensor):
        """nodes [batch, n, ...], edges [batch, n (n - 1), ...], receivers and senders [batch, n, n (n - 1)]."""
        objects, relations = self.object_encoder(nodes), self.relation_encoder(edges)
        effect = objects
        for _ in range(self.steps):
            ends = (receivers.transpose(1, 2) @ effect, senders.transpose(1, 2) @ effect)
            relation = self.relation_propagator(torch.cat((relations, *ends), -1))
            effect = (self.object_propagator(torch.cat((objects, receivers @ relation), -1)) + effect).relu()
        return self.head(effect)


def dense_inputs(batch: int, nodes: int) -> tuple[torch.Tensor, ...]:
    """Inputs of the dense formulation; its cost does not depend on their values."""
    pairs = [(i, j) for i in range(nodes) for j in range(nodes) if i != j]
    receivers, senders = torch.zeros(2, batch, nodes, len(pairs)).unbind()
    for k, (i, j) in enumerate(pairs):
        receivers[:, i, k] = senders[:, j, k] = 1
    return (
        torch.randn(batch, nodes, len(NODE_FEATURES)),
        torch.randn(batch, len(pairs), len(EDGE_FEATURES)),
        receivers,
        senders,
    )


def seconds(work: Callable[[], None]) -> float:
    """The fastest of some runs, after one to warm up."""
    work()
    taken = []
    for _ in range(REPEATS):
        begun = time.perf_counter()
        work()
        taken.append(time.perf_counter() - begun)
    return min(taken)


def windows(tracks: list[Track], frames: int) -> tuple[State, torch.Tensor, torch.Tensor]:
    """States at the start of the tracks, and what the tool does from there."""
    scenes = batch_scenes([track.scene for track in tracks])
    poses = torch.tensor(np.stack([track.poses[:frames] for track in tracks]), dtype=torch.float32)
    state = State(scenes, poses[:, 0, 1:], torch.zeros_like(poses[:, 0, 1:]), scenes.relations)
    return state, poses, torch.tensor(np.stack([track.down[:frames] for track in tracks]))


def rollout_seconds(predictor: PhysicsPredictor, tracks: list[Track], frames: int) -> float:
    state, poses, down = windows(tracks, frames)

    def work() -> None:
        with torch.no_grad():
            predictor.rollout(state, poses[:, :, 0], down)

    return seconds(work)


def final_error(predictor: PhysicsPredictor, tracks: list[Track], frames: int) -> float:
    """Mean distance (m) from the simulated tracks in the last frame, of objects that moved."""
    state, poses, down = windows(tracks, frames)
    with torch.no_grad():
        predicted = predictor.rollout(state, poses[:, :, 0], down).poses[:, -1]
    true = poses[:, :, 1:]
    moved = (true[:, -1] - true[:, 0])[..., :2].norm(dim=-1) > MOVED
    return float((predicted - true[:, -1])[..., :2].norm(dim=-1)[moved].mean())


def training_seconds(predictor: PhysicsPredictor, tracks: list[Track], frames: int) -> float:
    state, poses, down = windows(tracks, frames)
    dynamics = predictor.dynamics.train().requires_grad_(True)

    def work() -> None:
        now, predicted, loss = state, state.poses, 0.0
        for frame, control in enumerate(controls(poses[:, :, 0], down), start=1):
            predicted = predicted + dynamics(now, control).motion
            loss = loss + (predicted - poses[:, frame, 1:]).square().sum()
            now = now.observe(predicted.detach())
        loss.backward()

    taken = seconds(work)
    dynamics.eval().requires_grad_(False)
    return taken


def main(
    scenes: Annotated[int, typer.Option(help="Scenes side by side.")] = 256,
    objects: Annotated[int, typer.Option()] = 9,
    seed: Annotated[int, typer.Option(help="Of the scenes.")] = 1_000_000,
    out: Annotated[Path, typer.Option(help="Folder for the figures, JSON.")] = Path("rollout_speed"),
) -> None:
    torch.set_num_threads(1)
    predictors = {precision: PhysicsPredictor.load("contact", precision=precision) for precision in PRECISIONS}
    predictor, paper = predictors["float32"], PhysicsPredictor.load("propnet")
    tracks = [draw_trajectory("multiple-parts", objects, seed, index).track for index in range(scenes)]
    figures: dict[str, float] = {}

    for precision, one in predictors.items():
        figures[f"contact, {precision}, rollout"] = scenes * (FRAMES - 1) / rollout_seconds(one, tracks, FRAMES)
    figures["contact, training"] = scenes * 9 / training_seconds(predictor, tracks, 10)
    figures["propnet, rollout"] = scenes * 9 / rollout_seconds(paper, tracks, 10)

    dense, inputs = DensePropagationNetwork(), dense_inputs(32, objects + 1)
    with torch.no_grad():
        figures["dense reference, rollout"] = 32 / seconds(lambda: dense(*inputs))
    figures["dense reference, training"] = 32 / seconds(lambda: dense(*inputs).square().sum().backward())

    def simulate() -> None:
        for track in tracks[:24]:
            PlanarSimulation(track.scene).push(track.scene.pushes[0])

    stepped = sum(int((track.push == 0).sum()) - 1 for track in tracks[:24])
    figures["MuJoCo, with building the models"] = stepped / seconds(simulate)
    figures["MuJoCo"] = stepped / mujoco_seconds(tracks[:24])

    errors = {precision: final_error(one, tracks, FRAMES) for precision, one in predictors.items()}
    alone = sum(rollout_seconds(predictor, [track], FRAMES) for track in tracks[:SINGLES])
    alone_ms = 1e3 * alone / (len(tracks[:SINGLES]) * (FRAMES - 1))
    cost = {}
    for number in (6, 12, 24, 48, 96):
        crowd = [dense_first_push(number, index, seed) for index in range(2)] * 8  # large ones take long to draw
        frames = min(int((track.push == 0).sum()) for track in crowd)
        cost[number] = 1e3 * rollout_seconds(predictor, crowd, frames) / (16 * (frames - 1))

    table = Table(title=f"One thread, {scenes} scenes of {objects} objects; float32 unless said otherwise")
    for name in ("what", "scene-frames per second"):
        table.add_column(name, justify="left" if name == "what" else "right")
    for name, value in figures.items():
        table.add_row(name, f"{value:,.0f}")
    console = Console()
    console.print(table)
    ratios = {"training / dense reference": figures["contact, training"] / figures["dense reference, training"]}
    for precision in PRECISIONS:
        speed = figures[f"contact, {precision}, rollout"]
        ratios[f"{precision} rollout / dense reference"] = speed / figures["dense reference, rollout"]
        ratios[f"{precision} rollout / MuJoCo"] = speed / figures["MuJoCo"]
    ratios["final error, bfloat16 / float32"] = errors["bfloat16"] / errors["float32"]
    for name, value in ratios.items():
        console.print(f"{name}: {value:.3g}")
    accuracy = ", ".join(f"{precision} {error:.5f} m" for precision, error in errors.items())
    console.print(f"final error of what moved, {FRAMES} frames: {accuracy}")
    console.print(f"one scene by itself, ms per frame: {alone_ms:.2f}")
    console.print("ms per scene and frame: " + ", ".join(f"{n} objects {value:.3f}" for n, value in cost.items()))
    written = {"speed": figures, "ratios": ratios, "final_error": errors, "ms": cost, "ms_alone": alone_ms}
    out.mkdir(parents=True, exist_ok=True)
    (out / "rollout_speed.json").write_text(json.dumps(written, indent=1))
    console.print(f"Written: {out / 'rollout_speed.json'}")


def mujoco_seconds(tracks: list[Track]) -> float:
    """Time for stepping alone, the models already built."""
    taken = []
    for _ in range(REPEATS):
        simulations = [PlanarSimulation(track.scene) for track in tracks]
        begun = time.perf_counter()
        for simulation, track in zip(simulations, tracks, strict=True):
            simulation.push(track.scene.pushes[0])
        taken.append(time.perf_counter() - begun)
    return min(taken)


def dense_first_push(objects: int, index: int, seed: int) -> Track:
    """A dense scene of any size and its first push: more objects at equal density."""
    rng = np.random.default_rng([objects, seed, index])
    for _ in range(ATTEMPTS):
        with contextlib.suppress(NoRoom):
            plan = multiple_parts(rng, objects, 0)
            simulation = PlanarSimulation(plan.scene)
            simulation.push(aim(rng, plan.scene, simulation.poses, np.zeros(objects, dtype=np.int64), plan.style))
            return simulation.track()
    raise NoRoom


if __name__ == "__main__":
    typer.run(main)
