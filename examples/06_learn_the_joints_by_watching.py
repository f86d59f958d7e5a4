"""Watch a push frame by frame, learn what is joined, and predict the next push with what was learnt.

python examples/06_learn_the_joints_by_watching.py
"""

import numpy as np

import pushgraph as pg


def main() -> None:
    """Three discs in a row; two are hinged to each other, which only the simulator knows."""
    disc = pg.Cylinder(diameter=0.10)
    discs = tuple(
        pg.Body(name=name, shape=disc, pose_world_from_body=(0.11 * k, 0.0, 0.0), mass=0.5)
        for k, name in enumerate(("left", "middle", "right"))
    )
    hinge = pg.Joint(kind="revolute", parent="left", child="middle")
    first = pg.Push(start=(0.12, 0.15), end=(0.11, -0.03), speed=0.2)
    second = pg.Push(start=(-0.02, -0.16), end=(-0.02, 0.02), speed=0.2)
    truth = pg.Scene(bodies=discs, joints=(hinge,), pushes=(first, second), tool=pg.Tool.round(0.05))
    seen = pg.simulate(truth)

    regulator = pg.BeliefRegulator(truth.replace(joints=()))
    until = int(np.argmax(seen.push == 1))  # the second push is yet to come
    noise = np.random.default_rng(0).normal(size=seen.poses.shape) * [0.0005, 0.0005, 0.004]
    noise[:, 0] = 0.0  # the robot knows where it is
    track = pg.Track(truth, seen.times[:until], (seen.poses + noise)[:until], seen.push[:until], seen.seen[:until])
    for frame, (poses, down) in enumerate(track.frames()):
        probabilities = regulator.observe(poses, down)
        if frame % 8 == 0:
            row = dict(zip(regulator.pairs, probabilities, strict=True))["left", "middle"]
            print(
                f"frame {frame:2d}: none {row[0]:.2f} fixed {row[1]:.2f} prismatic {row[2]:.2f} revolute {row[3]:.2f}"
            )

    # The believed scene stands where the camera saw it last.
    believed = regulator.scene()
    print("believed:", ", ".join(f"{j.parent} and {j.child} {j.kind}" for j in believed.joints) or "nothing is joined")
    for title, scene in (("as believed", believed), ("if nothing were joined", believed.replace(joints=()))):
        predicted = pg.load().predict(scene, (second,))
        off = np.hypot(*(predicted.poses[-1, 1:, :2] - seen.poses[-1, 1:, :2]).T)
        print(f"next push predicted {title}: off by {', '.join(f'{100 * each:.1f}' for each in off)} cm")


if __name__ == "__main__":
    main()
