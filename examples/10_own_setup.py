"""A setup of one's own, rows of plates like dominoes: generated, trained on and measured in.

python examples/10_own_setup.py
"""


import numpy as np

import pushgraph as pg
from pushgraph.evaluation.physics import evaluate_physics
from pushgraph.simulation.aiming import PushStyle
from pushgraph.simulation.plan import DENSITIES, Plan


def dominoes(rng: np.random.Generator, objects: int, index: int) -> Plan:
    """A row of plates a little apart, every other one hinged to the next by chance; and three pushes."""
    thick, long = rng.uniform(0.02, 0.04), rng.uniform(0.08, 0.14)
    gap = rng.uniform(0.002, 0.01) if index % 2 == 0 else rng.uniform(0.02, 0.05)
    shape = pg.Cuboid(size=(float(thick), float(long)))
    bodies = tuple(
        pg.Body(
            name=f"plate{k}",
            shape=shape,
            pose_world_from_body=(float((k - objects / 2) * (thick + gap)), 0.0, 0.0),
            mass=float(rng.uniform(0.2, 1.0)),
        )
        for k in range(objects)
    )
    joints = tuple(
        pg.Joint(kind="revolute", parent=f"plate{k}", child=f"plate{k + 1}")
        for k in range(0, objects - 1, 2)
        if rng.random() < 0.5
    )
    style = PushStyle(distance=0.25, speed=float(rng.uniform(0.05, 0.2)), pushes=3)
    return Plan(pg.Scene(bodies=bodies, joints=joints), DENSITIES[index % 2], style)


pg.register_setup("dominoes", dominoes)


def main(count: int = 32, samples: int = 4_000, scenes: int = 8) -> None:
    """Train the contact network on dominoes, and measure it beside the shipped one, which has seen none."""
    data = pg.generate("dominoes", objects=5, count=count, seed=0, out="dominoes.h5")
    validation = pg.generate("dominoes", objects=5, count=4, seed=900_000, out="dominoes-validation.h5")
    training = pg.PhysicsTraining(
        data=str(data), validation=str(validation), samples=samples, hidden=16, batch=32
    )
    pg.train_physics(training, pg.TrainingRun(out="dominoes.safetensors"))
    models = {"own": "dominoes.safetensors", "contact": "contact"}
    results, _ = evaluate_physics([5], scenes, 1_000_000, models, setup="dominoes")
    for row in results.rows:
        if (row["metric"], row["frames"], row["density"]) == ("mean_error_cm", 50, "all"):
            print(f"{row['model']}: {row['value']:.2f} cm off on average over 50 frames")


if __name__ == "__main__":
    main()
