"""Describe a scene, see what three pushes do to it, and read the track like a camera's.

python examples/01_simulate_a_scene.py
"""

import numpy as np

import pushgraph as pg


def main() -> None:
    """A stick of two glued parts, a loose cup, and an L-shaped tool that turns."""
    handle = pg.Body(name="handle", shape=pg.Cuboid(size=(0.20, 0.04)), pose_world_from_body=(0, 0, 0), mass=0.3)
    head = pg.Body(name="head", shape=pg.Cylinder(diameter=0.10), pose_world_from_body=(0.16, 0, 0), mass=0.5)
    cup = pg.Body(name="cup", shape=pg.Cylinder(diameter=0.09), pose_world_from_body=(0.0, 0.12, 0), mass=0.2)
    tool = pg.Tool(
        parts=(
            pg.Part(shape=pg.Cuboid(size=(0.16, 0.03)), pose_tool_from_part=(-0.08, 0.0, 0.0)),
            pg.Part(shape=pg.Cuboid(size=(0.03, 0.10)), pose_tool_from_part=(0.0, 0.05, 0.0)),
        )
    )
    scene = pg.Scene(
        bodies=(handle, head, cup),
        joints=(pg.Joint(kind="fixed", parent="handle", child="head"),),
        tool=tool,
        pushes=(
            pg.Push(start=(-0.25, 0.0), direction=0.0, distance=0.2),
            pg.Push(start=(0.0, -0.2), direction=np.pi / 2, distance=0.15, yaw=np.pi / 2, speed=0.1),
            pg.Push(start=(0.25, 0.25), end=(0.15, 0.2), yaw=1.2, rotation=0.8),
        ),
    )
    track = pg.simulate(scene)
    for name, start, end in zip(track.nodes, track.poses[0], track.poses[-1], strict=True):
        moved = 100 * np.hypot(*(end - start)[:2])
        print(f"{name:7s} moved {moved:5.1f} cm and turned {np.degrees(end[2] - start[2]):6.1f} degrees")

    track.save("stick.csv")  # the format a camera's track comes in
    again = pg.Track.load("stick.csv", scene)
    print(f"{len(again.times)} frames, {again.push_start.sum()} pushes, lost tags: {again.gaps or 'none'}")
    pg.save_picture(track, "stick.png")


if __name__ == "__main__":
    main()
