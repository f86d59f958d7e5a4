"""How long one plan takes with learned dynamics and with MuJoCo: 7 tools x 64 sequences x 120 frames, on one core.

python benchmarks/planning_speed.py
"""

import time

import torch

from pushgraph.evaluation.tool_tasks import start_scenes
from pushgraph.physics import PhysicsPredictor
from pushgraph.planning.costs import position_cost
from pushgraph.planning.dynamics import learned, simulated
from pushgraph.planning.exhaustive import Candidates
from pushgraph.planning.sequences import sequences
from pushgraph.planning.tools import load_tools
from pushgraph.simulation.setups import FIRST_TEST_SEED, draw_trajectory

AHEAD = 0.12
"""Nine objects stand this far before the end-effector (m)."""


def scenes():
    """A cylinder that every tool clears, and nine objects of `multiple-parts` before the end-effector."""
    yield "1 object", start_scenes(FIRST_TEST_SEED)[0]
    clutter = draw_trajectory("multiple-parts", 9, FIRST_TEST_SEED, 0).track.scene
    nearest = clutter.poses_world_from_body[:, 0].min()
    yield "9 objects", clutter.moved((AHEAD - nearest, 0.0, 0.0))


def main() -> None:
    torch.set_num_threads(1)
    predict = learned(PhysicsPredictor.load())
    for name, scene in scenes():
        candidates = Candidates.of(scene, load_tools("all"), sequences())
        cost = position_cost(scene, scene.names[0], 0.3, 0.3)
        predict(candidates.plans[:2])
        seconds = {}
        for model, dynamics in (("learned", predict), ("mujoco", simulated)):
            begun = time.perf_counter()
            candidates = Candidates.of(scene, load_tools("all"), sequences())
            candidates.best(dynamics(candidates.plans), cost)
            seconds[model] = time.perf_counter() - begun
            print(f"{name}, {len(candidates.plans)} plans, {model}: {seconds[model]:.2f} s", flush=True)
        print(f"{name}: {seconds['mujoco'] / seconds['learned']:.1f} times as fast")


if __name__ == "__main__":
    main()
