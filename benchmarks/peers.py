"""Prediction beside what a user would write instead: Box2D and pymunk scenes, and MuJoCo, the reference itself.

.venv/bin/python -m pip install --constraint constraints.txt '.[peers]'
.venv/bin/python benchmarks/peers.py --scenes 256 --out peers
.venv/bin/python benchmarks/peers.py --scenes 64 --objects 200 --out peers-200

Both engines get the best friction that they can be given: a body stands on the feet that the simulator has, each a
friction joint with the world that resists no torque; they stand a little farther out, so that a spin on the spot meets
the torque of uniform pressure. One core, one run: 50 frames of the first push, scenes laid out before or in the time.
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
from pushgraph.evaluation.metrics import MOVED
from pushgraph.patch import mass_properties, patch_of
from pushgraph.physics import PhysicsPredictor
from pushgraph.scene import Scene
from pushgraph.shape import Cylinder
from pushgraph.simulation import planar
from pushgraph.simulation.feet import feet_of
from pushgraph.simulation.motion import ToolMotion
from pushgraph.simulation.planar import PlanarSimulation
from pushgraph.simulation.setups import draw_trajectory
from pushgraph.tool import Push
from pushgraph.track import FRAME, Track

GRAVITY = 9.81


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


class PeerScene:
    """A scene in another engine: what its two kinds share. SCALE: lengths are multiplied by it."""

    SCALE: float
    scene: Scene
    step: float
    pieces: list[Piece]
    bodies: list[object]

    def place_tool(self, place: np.ndarray) -> None:
        """Put the tool somewhere; x, y scaled, yaw (rad)."""
        raise NotImplementedError

    def advance(self, velocity: np.ndarray) -> None:
        """Drive the tool for one step; scaled."""
        raise NotImplementedError

    def poses(self) -> np.ndarray:
        """Of all bodies, pose_world_from_body."""
        found = np.zeros((len(self.scene.bodies), 3))
        for piece, body in zip(self.pieces, self.bodies, strict=True):
            place = np.array([body.position[0] / self.SCALE, body.position[1] / self.SCALE, body.angle])
            for k in piece.members:
                own = np.array(self.scene.bodies[k].pose_world_from_body, dtype=float)
                found[k] = own if piece.fixed else pose.compose(place, own - [*piece.origin, 0.0])
        return found

    def run(self, frames: int) -> np.ndarray:
        """Poses in every frame of the first push."""
        motion = ToolMotion(self.scene.pushes[0], self.scene.tool)
        substeps = round(FRAME / self.step)
        path = motion.poses(np.arange(frames * substeps + 1) * self.step) * [self.SCALE, self.SCALE, 1.0]
        self.place_tool(path[0])
        velocities = np.diff(path, axis=0) / self.step
        found = [self.poses()]
        for frame in range(frames):
            for velocity in velocities[frame * substeps : (frame + 1) * substeps]:
                self.advance(velocity)
            found.append(self.poses())
        return np.array(found)


class Box2DScene(PeerScene):
    """A scene in Box2D, which is made for things of 0.1 to 10 m."""

    SCALE = 10.0

    def __init__(self, scene: Scene, step: float, iterations: int) -> None:
        self.scene, self.step, self.iterations = scene, step, iterations
        self.world = Box2D.b2World(gravity=(0, 0), doSleep=True)
        ground = self.world.CreateStaticBody()
        self.pieces, self.owner = pieces_of(scene)
        self.bodies = []
        for piece in self.pieces:
            make = self.world.CreateStaticBody if piece.fixed else self.world.CreateDynamicBody
            body = make(position=(piece.origin * self.SCALE).tolist())
            self._add_shapes(body, placed_shapes(scene, piece))
            self.bodies.append(body)
            if piece.fixed:
                continue
            body.massData = Box2D.b2MassData(mass=piece.mass, center=(0, 0), I=piece.moment * self.SCALE**2)
            for point, weight in zip(piece.feet, piece.weights, strict=True):
                force = scene.table.friction * piece.mass * weight * GRAVITY * self.SCALE
                anchor = (point * self.SCALE).tolist()
                self.world.CreateFrictionJoint(bodyA=ground, bodyB=body, anchor=anchor, maxForce=force, maxTorque=0.0)
        self._add_joints()
        self.tool = self.world.CreateKinematicBody()
        shapes = outlines([(p.shape, np.array(p.pose_tool_from_part)) for p in scene.tool.parts])
        self._add_shapes(self.tool, shapes)

    def _add_shapes(self, body: object, shapes: list[tuple[float, np.ndarray]]) -> None:
        for radius, points in shapes:
            if radius:
                shape = Box2D.b2CircleShape(pos=(points * self.SCALE).tolist(), radius=radius * self.SCALE)
            else:
                shape = Box2D.b2PolygonShape(vertices=(points * self.SCALE).tolist())
                shape.radius = 0.001 * self.SCALE / 10
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
                    bodyA=a, bodyB=b, anchor=(frame.anchor * self.SCALE).tolist(), collideConnected=True, **limits
                )
            else:
                low, high = (limit * self.SCALE for limit in frame.limits)
                limits |= {"lowerTranslation": low, "upperTranslation": high}
                anchor, axis = (frame.anchor * self.SCALE).tolist(), frame.axis.tolist()
                self.world.CreatePrismaticJoint(bodyA=a, bodyB=b, anchor=anchor, axis=axis, **limits)

    def place_tool(self, place: np.ndarray) -> None:
        self.tool.position, self.tool.angle = place[:2].tolist(), float(place[2])

    def advance(self, velocity: np.ndarray) -> None:
        self.tool.linearVelocity, self.tool.angularVelocity = velocity[:2].tolist(), float(velocity[2])
        self.world.Step(self.step, self.iterations, self.iterations)


class PymunkScene(PeerScene):
    """A scene in pymunk, whose tolerances are made for lengths of 10 to 1,000."""

    SCALE = 100.0

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
                body = pymunk.Body(piece.mass, piece.moment * self.SCALE**2)
            body.position = tuple(piece.origin * self.SCALE)
            self.space.add(body)
            self._add_shapes(body, placed_shapes(scene, piece))
            self.bodies.append(body)
            for point, weight in zip(piece.feet, piece.weights, strict=True):
                local = tuple((point - piece.origin) * self.SCALE)
                slide = pymunk.PivotJoint(self.space.static_body, body, tuple(point * self.SCALE), local)
                slide.max_force = scene.table.friction * piece.mass * weight * GRAVITY * self.SCALE
                slide.max_bias = 0.0
                self.space.add(slide)
        index = {name: k for k, name in enumerate(scene.names)}
        for joint in scene.joints:
            if joint.kind == "fixed":
                continue
            a, b = (self.bodies[self.owner[index[name]]] for name in (joint.parent, joint.child))
            frame = scene.joint_frame(joint)
            anchor = frame.anchor * self.SCALE
            if joint.kind == "revolute":
                limit = pymunk.RotaryLimitJoint(a, b, max(frame.limits[0], -6.0), min(frame.limits[1], 6.0))
                self.space.add(pymunk.PivotJoint(a, b, tuple(anchor)), limit)
            else:
                ends = [tuple(anchor + limit * self.SCALE * frame.axis - a.position) for limit in frame.limits]
                groove = pymunk.GrooveJoint(a, b, *ends, tuple(anchor - b.position))
                groove.collide_bodies = False
                self.space.add(groove, pymunk.GearJoint(a, b, 0.0, 1.0))
        self.tool = pymunk.Body(body_type=pymunk.Body.KINEMATIC)
        self.space.add(self.tool)
        self._add_shapes(self.tool, outlines([(p.shape, np.array(p.pose_tool_from_part)) for p in scene.tool.parts]))

    def _add_shapes(self, body: pymunk.Body, shapes: list[tuple[float, np.ndarray]]) -> None:
        for radius, points in shapes:
            if radius:
                shape = pymunk.Circle(body, radius * self.SCALE, tuple(points * self.SCALE))
            else:
                shape = pymunk.Poly(body, [tuple(corner) for corner in points * self.SCALE])
            shape.friction, shape.elasticity = math.sqrt(self.scene.side_friction), 0.0
            self.space.add(shape)

    def place_tool(self, place: np.ndarray) -> None:
        self.tool.position, self.tool.angle = tuple(place[:2]), float(place[2])

    def advance(self, velocity: np.ndarray) -> None:
        self.tool.velocity, self.tool.angular_velocity = tuple(velocity[:2]), float(velocity[2])
        self.space.step(self.step)


class MujocoScene:
    """The reference itself. step: of time (s), its own by default."""

    def __init__(self, scene: Scene, step: float | None = None) -> None:
        self.scene, self.step, self.simulation = scene, step, PlanarSimulation(scene)

    def run(self, frames: int) -> np.ndarray:
        own = planar.TIMESTEP, planar.TRAVEL
        if self.step is not None:
            planar.TIMESTEP, planar.TRAVEL = self.step, math.inf
        motion = ToolMotion(self.scene.pushes[0], self.scene.tool)
        path = motion.poses(np.arange(frames + 1) * FRAME)
        times = tuple((np.arange(1, frames + 1) * FRAME).tolist())
        try:
            push = self.scene.pushes[0]
            way = tuple(map(tuple, path[1:].tolist()))
            self.simulation.push(Push(start=push.start, yaw=push.yaw, path=way, times=times, rest=0.0))
        finally:
            planar.TIMESTEP, planar.TRAVEL = own
        return self.simulation.track().poses[: frames + 1, 1:]


PEERS: dict[str, Callable[[Scene], PeerScene | MujocoScene]] = {
    "Box2D, 10 ms, 10 iterations": lambda scene: Box2DScene(scene, 0.01, 10),
    "Box2D, 5 ms, 20 iterations": lambda scene: Box2DScene(scene, 0.005, 20),
    "pymunk, 10 ms, 10 iterations": lambda scene: PymunkScene(scene, 0.01, 10),
    "pymunk, 5 ms, 30 iterations": lambda scene: PymunkScene(scene, 0.005, 30),
    "MuJoCo, 10 ms": lambda scene: MujocoScene(scene, 0.01),
    "MuJoCo, 2.5 ms": MujocoScene,
}
STEPS = {
    "pushgraph": {},
    "pushgraph, steps of 2.5 mm": {"longest_step": 0.0025},
    "pushgraph, steps of a frame": {"longest_step": 0.025},
    "pushgraph, of up to 4 frames": {"frames_per_step": 4, "longest_step": 0.025},
}
GROUPS = {"loose": (1, 1), "two joined": (2, 2), "three to seven joined": (3, 7), "more joined": (8, 99)}
"""Errors are shown by how many bodies are joined, too."""
SHOWN = (30, 50)
"""Frames after which errors are shown."""
SPACING = 2.0
"""Copies of scenes stand so far apart (m) where there shall be more objects at equal density."""


def among_others(scene: Scene, others: Sequence[Scene], objects: int) -> Scene:
    """The scene with the bodies of others beside it, as many as are asked for."""
    bodies, joints, groups = list(scene.bodies), list(scene.joints), list(scene.rigid_groups)
    side = math.ceil(math.sqrt(objects / len(scene.bodies)))
    for number, other in enumerate(others, start=1):
        if len(bodies) >= objects:
            break
        place = np.array([number % side * SPACING, number // side * SPACING, 0.0])
        names = {name: f"{name}-{number}" for name in other.names}
        moved = other.replace(table=other.table.replace(size=(20.0, 20.0))).moved(place)
        taken = [body for body in moved.bodies[: objects - len(bodies)]]
        kept = {body.name for body in taken}
        bodies += [body.replace(name=names[body.name]) for body in taken]
        joints += [
            joint.replace(parent=names[joint.parent], child=names[joint.child])
            for joint in moved.joints
            if {joint.parent, joint.child} <= kept
        ]
        groups += [tuple(names[name] for name in group) for group in moved.rigid_groups if set(group) <= kept]
    table = scene.table.replace(size=(20.0, 20.0))
    return scene.replace(bodies=tuple(bodies), joints=tuple(joints), rigid_groups=tuple(groups), table=table)


def errors_after(
    frames: int, poses: np.ndarray, tracks: Sequence[Track], joined: tuple[int, int] = (1, 99)
) -> tuple[float, float]:
    """Mean and median final error (cm) of bodies that moved, in groups of these sizes; poses[scene, frame, body]."""
    found = []
    for one, track in zip(poses, tracks, strict=True):
        true = track.poses[: frames + 1, 1:]
        if (track.push[: frames + 1] != 0).any() or len(true) <= frames:
            continue
        moved = np.linalg.norm(true[-1, :, :2] - true[0, :, :2], axis=-1) > MOVED
        sizes = joined_sizes(track.scene)
        moved &= (joined[0] <= sizes) & (sizes <= joined[1])
        error = np.linalg.norm(one[frames, : true.shape[1], :2] - true[-1, :, :2], axis=-1)
        found.append(error[moved])
    errors = 100 * np.concatenate((np.zeros(0), *found))
    return (float(errors.mean()), float(np.median(errors))) if len(errors) else (math.nan, math.nan)


def joined_sizes(scene: Scene) -> np.ndarray:
    """How many bodies each body is joined with, itself and chains of joints included."""
    index = {name: k for k, name in enumerate(scene.names)}
    label = np.arange(len(index))
    for joint in scene.joints:
        a, b = label[index[joint.parent]], label[index[joint.child]]
        label[label == max(a, b)] = min(a, b)
    return np.bincount(label, minlength=len(label))[label]


def main(
    scenes: Annotated[int, typer.Option(help="Test scenes.")] = 256,
    objects: Annotated[int, typer.Option(help="At equal density: the scene of nine, and others beside it.")] = 9,
    seed: Annotated[int, typer.Option(help="Of the scenes.")] = 1_000_000,
    largest_batch: Annotated[int, typer.Option(help="Of 1, 16, 256, 4096: scenes over again, if need be.")] = 256,
    out: Annotated[Path, typer.Option(help="Folder for the figures, JSON.")] = Path("peers"),
) -> None:
    torch.set_num_threads(1)
    frames = max(SHOWN)
    tracks = [draw_trajectory("multiple-parts", 9, seed, k).track for k in progress(range(scenes))]
    tracks = [track for track in tracks if int((track.push == 0).sum()) > min(SHOWN)]
    firsts = [track.scene.replace(pushes=track.scene.pushes[:1]) for track in tracks]
    if objects > 9:
        firsts = [among_others(scene, firsts[k + 1 :] + firsts[:k], objects) for k, scene in enumerate(firsts)]
    rows: dict[str, dict[str, float]] = {}

    def note(name: str, poses: np.ndarray, seconds: float, laid_out: float) -> None:
        rows[name] = {"scene_frames_per_second": len(tracks) * frames / seconds}
        rows[name]["laid_out_too"] = len(tracks) * frames / (seconds + laid_out)
        for shown in SHOWN:
            mean, median = errors_after(shown, poses, tracks)
            rows[name] |= {f"mean_cm_{shown}": mean, f"median_cm_{shown}": median}

    predictor = PhysicsPredictor.load("contact")
    paths = [ToolMotion(s.pushes[0], s.tool).poses(np.arange(frames + 1) * FRAME) for s in firsts]
    tool = torch.from_numpy(np.stack(paths))
    down = torch.ones(tool.shape[:2], dtype=torch.bool)
    predictor.rollout(predictor.start(firsts[:2]), tool[:2, :3], down[:2, :3])
    for name, options in STEPS.items():
        begun = time.perf_counter()
        state = predictor.start(firsts)
        laid_out = time.perf_counter() - begun
        begun = time.perf_counter()
        with torch.no_grad():
            poses = predictor.rollout(state, tool, down, **options).poses.numpy()
        note(name, poses, time.perf_counter() - begun, laid_out)
        if not options:
            by_group = {kind: errors_after(SHOWN[0], poses, tracks, sizes) for kind, sizes in GROUPS.items()}
    for name, make in PEERS.items():
        begun = time.perf_counter()
        made = [make(scene) for scene in progress(firsts, name)]
        laid_out = time.perf_counter() - begun
        begun = time.perf_counter()
        poses = [one.run(frames) for one in made]
        note(name, np.array(poses), time.perf_counter() - begun, laid_out)
    batches = {}
    for batch in (batch for batch in (1, 16, 256, 4096) if batch <= largest_batch):
        state = predictor.start([firsts[k % len(firsts)] for k in range(batch)])
        path = torch.stack([tool[k % len(firsts)] for k in range(batch)])
        begun = time.perf_counter()
        with torch.no_grad():
            predictor.rollout(state, path, torch.ones(path.shape[:2], dtype=torch.bool))
        batches[batch] = batch * frames / (time.perf_counter() - begun)

    title = f"{len(tracks)} scenes of {objects} objects, one core: final error of what moved, mean / median"
    table = Table(title=title)
    for column in ("", *(f"{shown} frames (cm)" for shown in SHOWN), "scene-frames/s", "laid out, too"):
        table.add_column(column, justify="right" if column else "left")
    for name, row in rows.items():
        errors = [f"{row[f'mean_cm_{shown}']:.3f} / {row[f'median_cm_{shown}']:.3f}" for shown in SHOWN]
        speeds = [f"{row[which]:,.0f}" for which in ("scene_frames_per_second", "laid_out_too")]
        table.add_row(name, *errors, *speeds)
    console = Console()
    console.print(table)
    for kind, (mean, median) in by_group.items():
        console.print(f"pushgraph, {kind}, {SHOWN[0]} frames: {mean:.3f} / {median:.3f} cm")
    for batch, speed in batches.items():
        console.print(f"pushgraph, {batch} side by side: {speed:,.0f} scene-frames/s, {1e3 / speed:.3f} ms each")
    out.mkdir(parents=True, exist_ok=True)
    written = {"scenes": len(tracks), "objects": objects, "rows": rows, "batches": batches, "groups": by_group}
    (out / "peers.json").write_text(json.dumps(written, indent=1))
    console.print(f"Written: {out / 'peers.json'}")


if __name__ == "__main__":
    typer.run(main)
