"""Steps of `pushgraph/Push-v0` a second of processor time: many tables in one batched rollout, one, and one in MuJoCo.

python benchmarks/environment_speed.py
"""

import time
from typing import Annotated

import gymnasium
import numpy as np
import torch
import typer
from rich.console import Console
from rich.table import Table

import pushgraph.environment  # noqa: F401
from pushgraph.simulation.setups import draw_setup


def inward(poses: np.ndarray, rng: np.random.Generator, table: float) -> np.ndarray:
    """Pushes of 15 to 30 cm from outside of all bodies, [tables bodies 3], through the outermost in some direction."""
    direction = rng.uniform(-np.pi, np.pi, len(poses))
    out = np.stack((np.cos(direction), np.sin(direction)), -1)
    outermost = (poses[..., :2] * out[:, None]).sum(-1).argmax(-1)
    start = poses[np.arange(len(poses)), outermost, :2] + 0.17 * out
    length = rng.uniform(0.5, 1.0, (len(poses), 1))
    return np.concatenate((start / (table / 2), -length * out), -1).astype(np.float32)


def main(tables: int = 1000, steps: int = 10, objects: int = 9, scenes: Annotated[int, typer.Option()] = 64) -> None:
    """Scenes of multiple-parts, drawn before; what setups draw as episodes begin is measured by itself."""
    torch.set_num_threads(1)
    begun = time.process_time()
    pool = [draw_setup("multiple-parts", objects, np.random.default_rng(k)) for k in range(scenes)]
    drawing = (time.process_time() - begun) / scenes
    result = Table("", "steps/s", "ms a step", "refused", title=f"{objects} bodies, one core")
    for name, count, dynamics, repeats in (
        (f"learned, {tables} tables", tables, "learned", steps),
        ("learned, one table", 1, "learned", 5 * steps),
        ("mujoco, one table", 1, "mujoco", 5 * steps),
    ):
        rng = np.random.default_rng(0)
        env = gymnasium.make_vec("pushgraph/Push-v0", num_envs=count, scenes=pool, dynamics=dynamics)
        seen, _ = env.reset(seed=0)
        seen, *_ = env.step(inward(seen["poses"], rng, seen["table"][0, 3]))  # compiles
        refused, begun = 0.0, time.process_time()
        for _ in range(repeats):
            seen, *_, info = env.step(inward(seen["poses"], rng, seen["table"][0, 3]))
            refused += np.mean(info["refused"] != "") / repeats
        each = (time.process_time() - begun) / (repeats * count)
        result.add_row(name, f"{1 / each:.0f}", f"{1e3 * each:.2f}", f"{refused:.1%}")
    Console().print(result)
    print(f"drawing a scene of a setup takes {1e3 * drawing:.0f} ms, which an episode over a drawn one begins with")


if __name__ == "__main__":
    typer.run(main)
