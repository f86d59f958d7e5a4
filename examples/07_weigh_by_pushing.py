"""Weigh discs by pushing them: with a camera alone, and with a force sensor beside it.

python examples/07_weigh_by_pushing.py
"""

import dataclasses

import numpy as np

import pushgraph as pg


def main() -> None:
    """Two discs, pushed one by way of the other; only the simulator knows what they weigh."""
    disc = pg.Cylinder(diameter=0.10)
    truth = pg.Scene(
        bodies=(
            pg.Body(name="near", shape=disc, pose_world_from_body=(0.0, 0.0, 0.0), mass=1.4),
            pg.Body(name="far", shape=disc, pose_world_from_body=(0.11, 0.025, 0.0), mass=0.4),
        ),
        pushes=(pg.Push(start=(-0.11, 0.0), end=(0.08, 0.0), speed=0.2),),
        tool=pg.Tool.round(0.05),
    )
    seen = pg.simulate(truth)
    assert seen.wrench is not None
    rng = np.random.default_rng(0)
    sensed = dataclasses.replace(seen, wrench=seen.wrench + rng.normal(size=seen.wrench.shape) * [0.3, 0.3, 0.01])
    camera = dataclasses.replace(seen, wrench=None)

    # A mass of None is unknown; what it may be, the scene's mass_classes tell: by default light, normal or heavy.
    scene = truth.replace(bodies=tuple(body.replace(mass=None) for body in truth.bodies))
    slippery = scene.replace(table=scene.table.replace(friction=None))
    for title, watched, track in (
        ("camera", scene, camera),
        ("camera and force sensor", scene, sensed),
        ("camera and force sensor, friction of the table unknown", slippery, sensed),
    ):
        print(title)
        for mass in pg.BeliefHistory.watch(watched, track).masses:
            (other, (ratio, least, most)), *_ = [*mass.ratios.items(), ("itself", (1.0, 1.0, 1.0))]
            classes = ", ".join(f"{name} {probability:.2f}" for name, probability in mass.classes.items())
            print(f"  {mass.body}: {classes}")
            print("    {:.2f} kg ({:.2f} to {:.2f})".format(*mass.mass))
            print("    slides at {:.1f} N ({:.1f} to {:.1f})".format(*mass.slide))
            print(f"    {ratio:.2f} times {other} ({least:.2f} to {most:.2f})")


if __name__ == "__main__":
    main()
