"""Reference for planar pushing, independent of the simulator: exact planar time stepping of one rigid piece on a table.

A piece of mass m and radius of gyration rho has the twist u = (v, omega) at its centre of mass. It presses on the table
with shares w_i (of m g) at points r_i. A step of length dt solves, implicitly in the new twist u,

    M (u - u_before) = -dt d/du sum_i mu_table w_i m g |v + omega x r_i| + sum_c J_c' lambda_c
    0 <= lambda_n, gap / dt + n.(v_c - v_tool) >= 0, one of them zero           (Signorini, no restitution)
    |lambda_t| <= mu_side lambda_n, against the slip if it slips                (Coulomb, without dilation)

with M = m diag(1, 1, rho^2). All is divided by m, which cancels. The sum of norms is minimised by iteratively
reweighted least squares: |s| <= s^2 / (2 s_k) + s_k / 2, equal where s = s_k, the slip of the iterate before. Then
contacts see a 3 x 3 system, and block Gauss-Seidel solves one contact after the other exactly. Many pushes are stepped
side by side.
"""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float, Int

from pushgraph import pose
from pushgraph.contact import RoundedBox, contact_between
from pushgraph.scene import Scene
from pushgraph.shape import Cuboid, Cylinder
from pushgraph.simulation.motion import ToolMotion
from pushgraph.track import FRAME

GRAVITY = 9.81
STEP = 2e-4
"""How far the tool moves at most in a step (m)."""
SAMPLES = 500
"""Points at which a piece presses on the table, about."""
REGULARISATION = 1e-3
"""Slip below this share of the push's speed counts as rest."""
NEAR = 1e-3
"""Contacts that are farther than this (m) are left out of a step."""
RECOVERED = 0.2
"""Share of an overlap that a step takes back."""
TOLERANCE = 1e-4
"""Change of the twist between iterations, as a share of the push's speed, at which a step is done."""
ITERATIONS, SWEEPS = 30, 30
"""At most so many reweightings in a step, and sweeps over the contacts in each."""


class Pressure(NamedTuple):
    """Where a piece presses on the table, in the world frame at the scene's poses; weights sum to its mass (kg)."""

    points: Float[np.ndarray, "samples 2"]
    weights: Float[np.ndarray, " samples"]

    @property
    def centre(self) -> Float[np.ndarray, "2"]:
        """Centre of mass (m)."""
        return self.weights @ self.points / self.weights.sum()

    @property
    def squared_gyration(self) -> float:
        """Moment of inertia about the centre of mass, per kilogram (m^2)."""
        return float(self.weights @ np.square(self.points - self.centre).sum(-1) / self.weights.sum())


def pressure(scene: Scene, samples: int = SAMPLES) -> Pressure:
    """Pressure of the scene's bodies, taken as one piece.

    Every body presses with its mass, evenly over its share of the outline: where k bodies overlap, a k-th is its own.
    """
    shapes = [body.shape for body in scene.bodies]
    poses = scene.poses_world_from_body
    areas = [math.pi * shape.core[2] ** 2 or 4 * shape.core[0] * shape.core[1] for shape in shapes]
    spacing = math.sqrt(sum(areas) / samples)
    points, weights = [], []
    for body, place in zip(scene.bodies, poses, strict=True):
        in_body, area = _disc(body.shape, spacing) if body.shape.core[2] else _rectangle(body.shape, spacing)
        here = pose.transform(place, in_body)
        covering = sum(_covers(shape, other, here) for shape, other in zip(shapes, poses, strict=True))
        share = area / np.maximum(covering, 1)
        points.append(here)
        weights.append(body.mass * share / share.sum())
    return Pressure(np.concatenate(points), np.concatenate(weights))


def reference_ends(
    scenes: Sequence[Scene],
    step: float = STEP,
    samples: int = SAMPLES,
    twists: Float[np.ndarray, "scenes 3"] | None = None,
) -> list[Float[np.ndarray, "bodies 3"]]:
    """pose_world_from_body of every body of each scene at the end of its single push, the tool's rest included.

    A scene holds one body, or one rigid group; every mass and friction is known. Yaws are not wrapped. `twists`: of the
    centres of mass at the start, in the world frame (m/s, rad/s); at rest if left out.
    """
    motions = [ToolMotion(scene.pushes[0], scene.tool) for scene in scenes]
    durations = np.array([motion.frames * FRAME for motion in motions])
    speeds = np.array([scene.pushes[0].speed for scene in scenes])
    steps = math.ceil((durations * speeds).max() / step)
    dt = durations / steps
    tool = np.array([[m.pose(k * h) for m, h in zip(motions, dt, strict=True)] for k in range(steps + 1)])

    pieces = [pressure(scene, samples) for scene in scenes]
    table = _TableFriction(pieces, [scene.table.friction for scene in scenes], REGULARISATION * speeds)
    sides = _Sides(scenes, pieces)
    piece = np.array([[*p.centre, 0.0] for p in pieces])
    start = piece.copy()
    twist = np.zeros((len(scenes), 3)) if twists is None else np.array(twists, dtype=float)
    impulses = np.zeros((len(scenes), sides.count, 2))
    for now, after in pairwise(tool):
        touching = sides.touching(piece, now, after, dt)
        in_piece = np.concatenate((pose.rotate(twist[:, :2], -piece[:, 2]), twist[:, 2:]), -1)
        in_piece, impulses = _step(in_piece, table, touching, impulses, dt, TOLERANCE * speeds)
        twist = np.concatenate((pose.rotate(in_piece[:, :2], piece[:, 2]), in_piece[:, 2:]), -1)
        piece = piece + dt[:, None] * twist
    return [
        pose.compose(end, pose.relative(first, scene.poses_world_from_body))
        for scene, first, end in zip(scenes, start, piece, strict=True)
    ]


def piece_pose(scene: Scene, poses_world_from_body: Float[np.ndarray, "bodies 3"]) -> Float[np.ndarray, "3"]:
    """Centre of mass of the scene's piece and its yaw since the scene's poses, where its bodies are at these poses."""
    first, now = scene.poses_world_from_body[0], poses_world_from_body[0]
    centre = pose.transform(now, pose.transform(pose.inverse(first), pressure(scene).centre))
    return np.array([*centre, now[2] - first[2]])


class _TableFriction:
    """Friction of pieces with the table, in their own frames, per kilogram."""

    def __init__(self, pieces: Sequence[Pressure], frictions: Sequence[float], rest: np.ndarray) -> None:
        longest = max(len(piece.weights) for piece in pieces)
        self.squared_gyration = np.array([piece.squared_gyration for piece in pieces])
        self._rest = rest
        # |v + omega x r|^2 is linear in 1, x, y and r^2; so are the entries of the reweighted matrix.
        self._moments = np.zeros((len(pieces), longest, 4))
        self._deceleration = np.zeros((len(pieces), longest))
        for k, (piece, friction) in enumerate(zip(pieces, frictions, strict=True)):
            x, y = (piece.points - piece.centre).T
            count = len(x)
            self._moments[k, :count] = np.stack((np.ones(count), x, y, x**2 + y**2), -1)
            self._deceleration[k, :count] = friction * GRAVITY * piece.weights / piece.weights.sum()

    def resistance(
        self, twist: Float[np.ndarray, "chosen 3"], chosen: Int[np.ndarray, " chosen"]
    ) -> Float[np.ndarray, "chosen 3 3"]:
        """Matrix D of the friction -D u that is exact at this twist (1/s); of the chosen pieces."""
        moments, rest = self._moments[chosen], self._rest[chosen]
        vx, vy, omega = twist.T
        terms = np.stack((vx**2 + vy**2 + rest**2, 2 * omega * vy, -2 * omega * vx, omega**2), -1)
        slip = np.sqrt((moments @ terms[..., None])[..., 0].clip(min=rest[:, None] ** 2))
        one, x, y, squared = np.moveaxis(((self._deceleration[chosen] / slip)[:, None] @ moments)[:, 0], -1, 0)
        zero = np.zeros_like(one)
        return np.moveaxis(np.array([[one, zero, -y], [zero, one, x], [-y, x, squared]]), -1, 0)


class _Touching(NamedTuple):
    """Contacts of a step, in the frames of the pieces.

    rows: of each contact, what a twist becomes along its normal (into the piece) and its tangent. target: the velocity
    along the normal that it must reach at least, and the tool's along the tangent (m/s).
    """

    near: Bool[np.ndarray, "scenes contacts"]
    rows: Float[np.ndarray, "scenes contacts 2 3"]
    target: Float[np.ndarray, "scenes contacts 2"]
    friction: Float[np.ndarray, " scenes"]

    def of(self, chosen: Int[np.ndarray, " chosen"]) -> "_Touching":
        """The contacts of some scenes."""
        return _Touching(*(field[chosen] for field in self))


class _Sides:
    """The sides of pieces and of their tools: two contacts for every pair of a body and a part of the tool."""

    def __init__(self, scenes: Sequence[Scene], pieces: Sequence[Pressure]) -> None:
        bodies = max(len(scene.bodies) for scene in scenes)
        parts = max(len(scene.tool.parts) for scene in scenes)
        self.count = 2 * bodies * parts
        self._friction = np.array([scene.side_friction for scene in scenes])
        self._exists = np.zeros((len(scenes), bodies, parts), dtype=bool)
        self._piece_from_body = np.zeros((len(scenes), bodies, 1, 3))
        self._tool_from_part = np.zeros((len(scenes), 1, parts, 3))
        cores = np.ones((2, len(scenes), bodies, parts, 3))
        for k, (scene, piece) in enumerate(zip(scenes, pieces, strict=True)):
            n, m = len(scene.bodies), len(scene.tool.parts)
            self._exists[k, :n, :m] = True
            self._piece_from_body[k, :n, 0] = scene.poses_world_from_body - [*piece.centre, 0.0]
            self._tool_from_part[k, 0, :m] = [part.pose_tool_from_part for part in scene.tool.parts]
            cores[0, k, :n] = np.array([body.shape.core for body in scene.bodies])[:, None]
            cores[1, k, :, :m] = [part.shape.core for part in scene.tool.parts]
        self._bodies, self._parts = (RoundedBox(core[..., :2], core[..., 2]) for core in torch.from_numpy(cores))

    def touching(
        self,
        piece: Float[np.ndarray, "scenes 3"],
        tool: Float[np.ndarray, "scenes 3"],
        tool_after: Float[np.ndarray, "scenes 3"],
        dt: Float[np.ndarray, " scenes"],
    ) -> _Touching:
        """Contacts at these poses, while the tool moves on in dt."""
        now, after = (pose.relative(piece, there) for there in (tool, tool_after))
        piece_from_part = pose.compose(now[:, None, None], self._tool_from_part)
        body_from_part = torch.from_numpy(pose.relative(self._piece_from_body, piece_from_part))
        contact = contact_between(self._bodies, self._parts, body_from_part)
        normal = pose.rotate(-contact.normal.numpy(), self._piece_from_body[..., 2])[..., None, :].repeat(2, -2)
        points = pose.transform(self._piece_from_body[..., None, :], contact.points_a.numpy())
        gaps = contact.gaps.numpy()
        apart = np.ones(gaps.shape, dtype=bool)
        apart[..., 1] = np.abs(points[..., 1, :] - points[..., 0, :]).max(-1) > 1e-9
        near = apart & self._exists[..., None] & (gaps < NEAR)

        flat = (len(piece), self.count)
        normal, points = normal.reshape(*flat, 2), points.reshape(*flat, 2)
        gaps, near = gaps.reshape(flat), near.reshape(flat)
        on_tool = pose.transform(pose.inverse(now)[:, None], points)
        tool_velocity = (pose.transform(after[:, None], on_tool) - points) / dt[:, None, None]
        directions = np.stack((normal, np.stack((-normal[..., 1], normal[..., 0]), -1)), -2)
        x, y = points[..., None, 0], points[..., None, 1]
        turning = x * directions[..., 1] - y * directions[..., 0]
        target = (directions @ tool_velocity[..., None])[..., 0]
        target[..., 0] -= np.where(gaps > 0, gaps, RECOVERED * gaps) / dt[:, None]
        return _Touching(near, np.concatenate((directions, turning[..., None]), -1), target, self._friction)


def _step(
    before: Float[np.ndarray, "scenes 3"],
    table: _TableFriction,
    touching: _Touching,
    impulses: Float[np.ndarray, "scenes contacts 2"],
    dt: Float[np.ndarray, " scenes"],
    tolerance: Float[np.ndarray, " scenes"],
) -> tuple[Float[np.ndarray, "scenes 3"], Float[np.ndarray, "scenes contacts 2"]]:
    """Twists after a step, and the impulses at the contacts, per kilogram; from those of the step before."""
    inertia = np.stack((np.ones_like(dt), np.ones_like(dt), table.squared_gyration), -1)
    impulses = np.where(touching.near[..., None], impulses, 0.0)
    twist = before.copy()
    moving = np.arange(len(dt))
    for _ in range(ITERATIONS):
        last = twist[moving]
        system = inertia[moving, None] * np.eye(3) + dt[moving, None, None] * table.resistance(last, moving)
        inverse = np.linalg.inv(system)
        free = (inverse @ (inertia * before)[moving, :, None])[..., 0]
        twist[moving], impulses[moving] = _solve_contacts(
            free, inverse, touching.of(moving), impulses[moving], tolerance[moving] / 10
        )
        change = np.abs(twist[moving] - last) * np.sqrt(inertia[moving])
        moving = moving[(change > tolerance[moving, None]).any(-1)]
        if not len(moving):
            break
    return twist, impulses


def _solve_contacts(
    free: Float[np.ndarray, "scenes 3"],
    inverse: Float[np.ndarray, "scenes 3 3"],
    touching: _Touching,
    impulses: Float[np.ndarray, "scenes contacts 2"],
    tolerance: Float[np.ndarray, " scenes"],
) -> tuple[Float[np.ndarray, "scenes 3"], Float[np.ndarray, "scenes contacts 2"]]:
    """Twists and impulses at which every contact keeps Signorini's and Coulomb's law, by block Gauss-Seidel.

    `free` are the twists without contacts, `inverse` what a generalised impulse adds to them.
    """
    used = np.flatnonzero(touching.near.any(0))
    if not len(used):
        return free, impulses
    impulses = impulses.copy()
    rows = touching.rows[:, used]
    responses = inverse[:, None] @ np.swapaxes(rows, -1, -2)
    delassus = rows @ responses
    twist = free + (responses @ impulses[:, used, :, None])[..., 0].sum(1)
    for _ in range(SWEEPS if (touching.near.sum(-1) > 1).any() else 1):
        last = twist
        for at, contact in enumerate(used):
            own = delassus[:, at]
            old = impulses[:, contact]
            velocity = (rows[:, at] @ twist[..., None])[..., 0] - touching.target[:, contact]
            without = velocity - (own @ old[..., None])[..., 0]
            new = _coulomb(own, without, touching.friction) * touching.near[:, contact, None]
            twist = twist + (responses[:, at] @ (new - old)[..., None])[..., 0]
            impulses[:, contact] = new
        if (np.abs(twist - last)[:, :2] < tolerance[:, None]).all():
            break
    return twist, impulses


def _coulomb(
    delassus: Float[np.ndarray, "scenes 2 2"],
    velocity: Float[np.ndarray, "scenes 2"],
    friction: Float[np.ndarray, " scenes"],
) -> Float[np.ndarray, "scenes 2"]:
    """Impulse (normal, tangent) of a lone contact that has this velocity without it; it opens, sticks or slips.

    With it, the contact's velocity relative to the tool is `velocity + delassus @ impulse`.
    """
    nn, nt, tt = delassus[:, 0, 0], delassus[:, 0, 1], delassus[:, 1, 1]
    normal, tangent = velocity.T
    determinant = nn * tt - nt**2
    stick = np.stack((nt * tangent - tt * normal, nt * normal - nn * tangent), -1) / determinant[:, None]
    sticks = np.abs(stick[:, 1]) <= friction * stick[:, 0]
    forward, backward = (-normal / np.maximum(nn + sign * friction * nt, 1e-3 * nn) for sign in (1, -1))
    # A tangential impulse along +t belongs to a slip along -t.
    along = tangent + (nt + friction * tt) * forward <= 0
    slip = np.where(along, forward, backward)
    slipping = np.stack((slip, np.where(along, friction, -friction) * slip), -1)
    impulse = np.where(sticks[:, None], stick, slipping)
    return np.where((normal < 0)[:, None], impulse, 0.0)


def _gauss(half_length: float, spacing: float) -> np.ndarray:
    """Two Gauss points in each cell of about two spacings, so that second moments are exact."""
    cells = max(2, round(half_length / spacing))
    middles = (np.arange(cells) + 0.5) / cells * 2 - 1
    offset = 1 / (cells * math.sqrt(3))
    return half_length * np.sort(np.concatenate((middles - offset, middles + offset)))


def _rectangle(shape: Cuboid, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    half_x, half_y, _ = shape.core
    x, y = np.meshgrid(_gauss(half_x, spacing), _gauss(half_y, spacing))
    return np.stack((x.ravel(), y.ravel()), -1), np.ones(x.size)


def _disc(shape: Cylinder, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Rings at the Gauss points of the squared radius, so that the second moment is exact."""
    radius = shape.core[2]
    nodes, weights = np.polynomial.legendre.leggauss(max(4, round(radius / spacing)))
    around = max(12, round(math.pi * radius / spacing))
    angles = 2 * math.pi * (np.arange(around) + np.arange(len(nodes))[:, None] / 2) / around
    rings = radius * np.sqrt((nodes[:, None] + 1) / 2)
    points = np.stack((rings * np.cos(angles), rings * np.sin(angles)), -1)
    return points.reshape(-1, 2), np.repeat(weights, around)


def _covers(shape: Cuboid | Cylinder, pose_world_from_body: np.ndarray, points_world: np.ndarray) -> np.ndarray:
    half_x, half_y, radius = shape.core
    x, y = pose.transform(pose.inverse(pose_world_from_body), points_world).T
    return np.hypot(x, y) <= radius if radius else (np.abs(x) <= half_x) & (np.abs(y) <= half_y)
