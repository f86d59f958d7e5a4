"""Predict a scene with the shipped network, simulate the same, and see how far apart they end.

python examples/04_predict_and_compare.py
"""

import numpy as np

import pushgraph as pg


def main() -> None:
    """A hinged lid, a drawer that slides, and a loose tin, pushed three times."""
    scene = pg.Scene(
        bodies=(
            pg.Body(name="box", shape=pg.Cuboid(size=(0.14, 0.10)), pose_world_from_body=(0, 0, 0), mass=0.8),
            pg.Body(name="lid", shape=pg.Cuboid(size=(0.14, 0.08)), pose_world_from_body=(0.15, 0, 0), mass=0.3),
            pg.Body(name="drawer", shape=pg.Cuboid(size=(0.12, 0.08)), pose_world_from_body=(0, -0.095, 0), mass=0.3),
            pg.Body(name="tin", shape=pg.Cylinder(diameter=0.10), pose_world_from_body=(-0.05, 0.15, 0), mass=0.5),
        ),
        joints=(
            pg.Joint(kind="revolute", parent="box", child="lid", anchor=(0.075, -0.03)),
            pg.Joint(kind="prismatic", parent="box", child="drawer", axis=(1.0, 0.0), limits=(-0.08, 0.08)),
        ),
        tool=pg.Tool.round(0.05),
        pushes=(
            pg.Push(start=(0.19, 0.12), end=(0.17, -0.05)),
            pg.Push(start=(-0.12, -0.10), end=(-0.02, -0.10), speed=0.1),
            pg.Push(start=(-0.15, 0.22), end=(0.00, 0.12)),
        ),
    )
    predictor = pg.load()
    predicted, simulated = predictor.predict(scene), pg.simulate(scene)
    off = predicted.poses[-1] - simulated.poses[-1]
    moved = simulated.poses[-1] - simulated.poses[0]
    for node, name in enumerate(predicted.nodes[1:], start=1):
        print(
            f"{name:>7} moved {100 * np.hypot(*moved[node, :2]):5.1f} cm, {np.degrees(moved[node, 2]):6.1f} deg; "
            f"predicted within {100 * np.hypot(*off[node, :2]):.1f} cm, {abs(np.degrees(off[node, 2])):.1f} deg"
        )
    pg.save_comparison({"Predicted": predicted, "Simulated": simulated}, "comparison.png")

    # The same pushes if nobody had told the robot what is joined to what.
    loose = predictor.predict(scene.replace(joints=()))
    away = loose.poses[-1, 2, :2] - predicted.poses[-1, 2, :2]
    print(f"without its hinge the lid would end {100 * np.hypot(*away):.1f} cm from there")


if __name__ == "__main__":
    main()
