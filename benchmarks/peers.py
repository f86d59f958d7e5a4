"""Prediction beside what a user would write instead: Box2D and pymunk scenes, and MuJoCo, the reference itself.

.venv/bin/python -m pip install --constraint constraints.txt '.[peers]'
.venv/bin/python benchmarks/peers.py --scenes 100 --out peers

Both engines get the best friction that they can be given: a body stands on the feet that the simulator has, each a
friction joint with the world that resists no torque; they stand a little farther out, so that a spin on the spot meets
the torque of uniform pressure. One core, one run.
"""

import json
import math
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, NamedTuple

import Box2D
import numpy as np
import pymunk
import torch
import typer
from rich.console import Console
from rich.progress import track as progress
from rich.table import Table

from pushgraph import pose
from pushgraph.evaluation.metrics import RolloutError
from pushgraph.patch import mass_properties, patch_of
from pushgraph.physics import PhysicsPredictor
from pushgraph.scene import Scene
from pushgraph.shape import Cylinder
from pushgraph.simulation.feet import feet_of
from pushgraph.simulation.motion import ToolMotion
from pushgraph.simulation.planar import PlanarSimulation
from pushgraph.simulation.setups import draw_trajectory
from pushgraph.track import FRAME, Track

GRAVITY = 9.81
SCALE = 10.0
"""Box2D is made for things of 0.1 to 10 m: lengths are scaled by this."""
CENTIMETRES = 100.0
"""pymunk's tolerances are made for lengths of 10 to 1,000."""


class Piece(NamedTuple):
    """Bodies that move as one. origin: centre of mass, world (m)."""

    members: list[int]
    origin: np.ndarray
    mass: float
    moment: float
    feet: np.ndarray
    weights: np.ndarray
    fixed: bool


def pieces_of(scene: Scene) -> tuple[list[Piece], list[int]]:
    """Pieces of a scene, and which of them each body belongs to."""
    label = list(range(len(scene.bodies)))
    index = {name: k for k, name in enumerate(scene.names)}
    rigid = [tuple(index[name] for name in group) for group in scene.rigid_groups]
    rigid += [(index[joint.parent], index[joint.child]) for joint in scene.joints if joint.kind == "fixed"]
    for group in rigid:
        old = {label[k] for k in group}
        label = [min(old) if one in old else one for one in label]
    pieces, owner = [], [0] * len(label)
    for number, first in enumerate(dict.fromkeys(label)):
        members = [k for k, one in enumerate(label) if one == first]
        for k in members:
            owner[k] = number
        bodies = [scene.bodies[k] for k in members]
        fixed = any(scene.immovable[k] for k in members)
        if fixed:
            pieces.append(Piece(members, np.zeros(2), 0.0, 0.0, np.zeros((0, 2)), np.zeros(0), True))
            continue
        inertia, patch = mass_properties(bodies), patch_of(bodies)
        feet = feet_of(patch)
        away = feet.points - patch.centre
        away = away * (patch.mean_radius / (feet.weights @ np.hypot(*away.T)))
        place = inertia.centre_of_mass
        pieces.append(
            Piece(
                members, place, inertia.mass, inertia.moment_of_inertia, patch.centre + away, feet.weights, False
            )
        )
    return pieces, owner


def outlines(shapes_and_poses: Sequence[tuple[object, np.ndarray]]) -> list[tuple[float, np.ndarray]]:
    """Radius and centre of discs, or zero and the corners of boxes."""
    found = []
    for shape, place in shapes_and_poses:
        if isinstance(shape, Cylinder):
            found.append((shape.diameter / 2, place[:2]))
        else:
            corners = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) * np.array(shape.size) / 2
            found.append((0.0, pose.transform(place, corners)))
    return found


def placed_shapes(scene: Scene, piece: Piece) -> list[tuple[float, np.ndarray]]:
    shapes = []
    for k in piece.members:
        place = np.array(scene.bodies[k].pose_world_from_body, dtype=float) - [*piece.origin, 0.0]
        for part in scene.bodies[k].shape.parts:
            shapes.append((part.shape, pose.compose(place, np.array(part.pose_body_from_part))))
    return outlines(shapes)


class Box2DScene:
    """A scene in Box2D."""

    def __init__(self, scene: Scene, step: float, iterations: int) -> None:
        self.scene, self.step, self.iterations = scene, step, iterations
        self.world = Box2D.b2World(gravity=(0, 0), doSleep=True)
        ground = self.world.CreateStaticBody()
        self.pieces, self.owner = pieces_of(scene)
        self.bodies = []
        for piece in self.pieces:
            make = self.world.CreateStaticBody if piece.fixed else self.world.CreateDynamicBody
            body = make(position=(piece.origin * SCALE).tolist())
            self._add_shapes(body, placed_shapes(scene, piece))
            self.bodies.append(body)
            if piece.fixed:
                continue
            body.massData = Box2D.b2MassData(mass=piece.mass, center=(0, 0), I=piece.moment * SCALE**2)
            for point, weight in zip(piece.feet, piece.weights, strict=True):
                force = scene.table.friction * piece.mass * weight * GRAVITY * SCALE
                anchor = (point * SCALE).tolist()
                self.world.CreateFrictionJoint(bodyA=ground, bodyB=body, anchor=anchor, maxForce=force, maxTorque=0.0)
        self._add_joints()
        self.tool = self.world.CreateKinematicBody()
        shapes = outlines([(p.shape, np.array(p.pose_tool_from_part)) for p in scene.tool.parts])
        self._add_shapes(self.tool, shapes)

    def _add_shapes(self, body: object, shapes: list[tuple[float, np.ndarray]]) -> None:
        for radius, points in shapes:
            if radius:
                shape = Box2D.b2CircleShape(pos=(points * SCALE).tolist(), radius=radius * SCALE)
            else:
                shape = Box2D.b2PolygonShape(vertices=(points * SCALE).tolist())
                shape.radius = 0.001 * SCALE / 10
            body.CreateFixture(shape=shape, density=1.0, friction=self.scene.side_friction, restitution=0.0)

    def _add_joints(self) -> None:
        index = {name: k for k, name in enumerate(self.scene.names)}
        for joint in self.scene.joints:
            if joint.kind == "fixed":
                continue
            a, b = (self.bodies[self.owner[index[name]]] for name in (joint.parent, joint.child))
            frame = self.scene.joint_frame(joint)
            limits = {"enableLimit": True}
            if joint.kind == "revolute":
                limits |= {"lowerAngle": max(frame.limits[0], -6.0), "upperAngle": min(frame.limits[1], 6.0)}
                self.world.CreateRevoluteJoint(
                    bodyA=a, bodyB=b, anchor=(frame.anchor * SCALE).tolist(), collideConnected=True, **limits
                )
            else:
                limits |= {"lowerTranslation": frame.limits[0] * SCALE, "upperTranslation": frame.limits[1] * SCALE}
                anchor, axis = (frame.anchor * SCALE).tolist(), frame.axis.tolist()
                self.world.CreatePrismaticJoint(bodyA=a, bodyB=b, anchor=anchor, axis=axis, **limits)

    def poses(self) -> np.ndarray:
        found = np.zeros((len(self.scene.bodies), 3))
        for piece, body in zip(self.pieces, self.bodies, strict=True):
            for k in piece.members:
                own = np.array(self.scene.bodies[k].pose_world_from_body, dtype=float)
                if not piece.fixed:
                    place = np.array([body.position[0] / SCALE, body.position[1] / SCALE, body.angle])
                    own = pose.compose(place, own - [*piece.origin, 0.0])
                found[k] = own
        return found

    def run(self, frames: int) -> np.ndarray:
        motion = ToolMotion(self.scene.pushes[0], self.scene.tool)
        substeps = round(FRAME / self.step)
        path = motion.poses(np.arange(frames * substeps + 1) * self.step)
        x, y, yaw = path[0]
        self.tool.position, self.tool.angle = (x * SCALE, y * SCALE), yaw
        found = [self.poses()]
        for frame in range(frames):
            for k in range(frame * substeps, (frame + 1) * substeps):
                velocity = (path[k + 1] - path[k]) / self.step
                self.tool.linearVelocity = (velocity[:2] * SCALE).tolist()
                self.tool.angularVelocity = velocity[2]
                self.world.Step(self.step, self.iterations, self.iterations)
            found.append(self.poses())
        return np.array(found)


class PymunkScene:
    """A scene in pymunk."""

    def __init__(self, scene: Scene, step: float, iterations: int) -> None:
        self.scene, self.step = scene, step
        self.space = pymunk.Space()
        self.space.gravity, self.space.iterations = (0, 0), iterations
        self.space.collision_slop = 0.005
        self.pieces, self.owner = pieces_of(scene)
        self.bodies = []
        for piece in self.pieces:
            if piece.fixed:
                body = pymunk.Body(body_type=pymunk.Body.STATIC)
            else:
                body = pymunk.Body(piece.mass, piece.moment * CENTIMETRES**2)
            body.position = tuple(piece.origin * CENTIMETRES)
            self.space.add(body)
            self._add_shapes(body, placed_shapes(scene, piece))
            self.bodies.append(body)
            for point, weight in zip(piece.feet, piece.weights, strict=True):
                local = tuple((point - piece.origin) * CENTIMETRES)
                slide = pymunk.PivotJoint(self.space.static_body, body, tuple(point * CENTIMETRES), local)
                slide.max_force = scene.table.friction * piece.mass * weight * GRAVITY * CENTIMETRES
                slide.max_bias = 0.0
                self.space.add(slide)
        index = {name: k for k, name in enumerate(scene.names)}
        for joint in scene.joints:
            if joint.kind == "fixed":
                continue
            a, b = (self.bodies[self.owner[index[name]]] for name in (joint.parent, joint.child))
            frame = scene.joint_frame(joint)
            anchor = frame.anchor * CENTIMETRES
            if joint.kind == "revolute":
                limit = pymunk.RotaryLimitJoint(a, b, max(frame.limits[0], -6.0), min(frame.limits[1], 6.0))
                self.space.add(pymunk.PivotJoint(a, b, tuple(anchor)), limit)
            else:
                ends = [tuple(anchor + limit * CENTIMETRES * frame.axis - a.position) for limit in frame.limits]
                groove = pymunk.GrooveJoint(a, b, *ends, tuple(anchor - b.position))
                groove.collide_bodies = False
                self.space.add(groove, pymunk.GearJoint(a, b, 0.0, 1.0))
        self.tool = pymunk.Body(body_type=pymunk.Body.KINEMATIC)
        self.space.add(self.tool)
        self._add_shapes(self.tool, outlines([(p.shape, np.array(p.pose_tool_from_part)) for p in scene.tool.parts]))

    def _add_shapes(self, body: pymunk.Body, shapes: list[tuple[float, np.ndarray]]) -> None:
        for radius, points in shapes:
            if radius:
                shape = pymunk.Circle(body, radius * CENTIMETRES, tuple(points * CENTIMETRES))
            else:
                shape = pymunk.Poly(body, [tuple(corner) for corner in points * CENTIMETRES])
            shape.friction, shape.elasticity = math.sqrt(self.scene.side_friction), 0.0
            self.space.add(shape)

    def poses(self) -> np.ndarray:
        found = np.zeros((len(self.scene.bodies), 3))
        for piece, body in zip(self.pieces, self.bodies, strict=True):
            place = np.array([body.position[0] / CENTIMETRES, body.position[1] / CENTIMETRES, body.angle])
            for k in piece.members:
                own = np.array(self.scene.bodies[k].pose_world_from_body, dtype=float)
                found[k] = own if piece.fixed else pose.compose(place, own - [*piece.origin, 0.0])
        return found

    def run(self, frames: int) -> np.ndarray:
        motion = ToolMotion(self.scene.pushes[0], self.scene.tool)
        substeps = round(FRAME / self.step)
        path = motion.poses(np.arange(frames * substeps + 1) * self.step)
        x, y, yaw = path[0]
        self.tool.position, self.tool.angle = (x * CENTIMETRES, y * CENTIMETRES), yaw
        found = [self.poses()]
        for frame in range(frames):
            for k in range(frame * substeps, (frame + 1) * substeps):
                velocity = (path[k + 1] - path[k]) / self.step
                self.tool.velocity = tuple(velocity[:2] * CENTIMETRES)
                self.tool.angular_velocity = float(velocity[2])
                self.space.step(self.step)
            found.append(self.poses())
        return np.array(found)


class MujocoScene:
    """The reference itself, for its speed."""

    def __init__(self, scene: Scene) -> None:
        self.scene, self.simulation = scene, PlanarSimulation(scene)

    def run(self, frames: int) -> np.ndarray:
        self.simulation.push(self.scene.pushes[0])
        return self.simulation.track().poses[: frames + 1, 1:]


PEERS: dict[str, Callable[[Scene], Box2DScene | PymunkScene | MujocoScene]] = {
    "Box2D, 10 ms, 10 iterations": lambda scene: Box2DScene(scene, 0.01, 10),
    "Box2D, 5 ms, 20 iterations": lambda scene: Box2DScene(scene, 0.005, 20),
    "pymunk, 10 ms, 10 iterations": lambda scene: PymunkScene(scene, 0.01, 10),
    "pymunk, 5 ms, 30 iterations": lambda scene: PymunkScene(scene, 0.005, 30),
}
STEPS = {"pushgraph": 1, "pushgraph, steps of 2 frames": 2, "pushgraph, steps of 4 frames": 4}


def main(
    scenes: Annotated[int, typer.Option(help="Test scenes.")] = 100,
    objects: Annotated[int, typer.Option()] = 9,
    frames: Annotated[int, typer.Option(help="Frames of the first push that are predicted.")] = 30,
    seed: Annotated[int, typer.Option(help="Of the scenes.")] = 1_000_000,
    out: Annotated[Path, typer.Option(help="Folder for the figures, JSON.")] = Path("peers"),
) -> None:
    torch.set_num_threads(1)
    tracks = [draw_trajectory("multiple-parts", objects, seed, k).track for k in progress(range(scenes))]
    tracks = [track for track in tracks if int((track.push == 0).sum()) > frames]
    firsts = [track.scene.replace(pushes=track.scene.pushes[:1]) for track in tracks]
    count = len(tracks) * (frames - 1)
    rows = {}

    def note(name: str, predicted: Sequence[Track], seconds: float, done: int) -> None:
        pairs = zip(predicted, tracks, strict=True)
        errors = [RolloutError(one, true, frames) for one, true in pairs]
        moved = 100 * np.concatenate([error.final[error.moved] for error in errors])
        rows[name] = {
            "mean_cm": float(moved.mean()),
            "median_cm": float(np.median(moved)),
            "scene_frames_per_second": done / seconds,
        }

    predictor = PhysicsPredictor.load("contact")
    for name, per_step in STEPS.items():
        predictor.predict_many(firsts[:4], 4, per_step)
        begun = time.perf_counter()
        predicted = predictor.predict_many(firsts, frames, per_step)
        note(name, predicted, time.perf_counter() - begun, count)
    for name, make in PEERS.items():
        made = [make(scene) for scene in firsts]
        begun = time.perf_counter()
        poses = [one.run(frames - 1) for one in made]
        seconds = time.perf_counter() - begun
        predicted = [
            Track(
                track.scene,
                track.times[:frames],
                np.concatenate((track.poses[:frames, :1], moved), 1),
                track.push[:frames],
                track.seen[:frames],
            )
            for track, moved in zip(tracks, poses, strict=True)
        ]
        note(name, predicted, seconds, count)
    few = [MujocoScene(scene) for scene in firsts[:24]]
    stepped = sum(int((track.push == 0).sum()) - 1 for track in tracks[:24])
    begun = time.perf_counter()
    for one in few:
        one.run(frames - 1)
    mujoco_speed = stepped / (time.perf_counter() - begun)

    title = f"{len(tracks)} scenes of {objects} objects, {frames} frames, final error of what moved, one core"
    table = Table(title=title)
    for name in ("", "mean (cm)", "median (cm)", "scene-frames a second"):
        table.add_column(name, justify="right" if name else "left")
    for name, row in rows.items():
        table.add_row(
            name, f"{row['mean_cm']:.3f}", f"{row['median_cm']:.3f}", f"{row['scene_frames_per_second']:,.0f}"
        )
    table.add_row("MuJoCo, the reference", "0", "0", f"{mujoco_speed:,.0f}")
    console = Console()
    console.print(table)
    out.mkdir(parents=True, exist_ok=True)
    written = {"scenes": len(tracks), "objects": objects, "frames": frames, "rows": rows, "mujoco": mujoco_speed}
    (out / "peers.json").write_text(json.dumps(written, indent=1))
    console.print(f"Written: {out / 'peers.json'}")


if __name__ == "__main__":
    typer.run(main)
