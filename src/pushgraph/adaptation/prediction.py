"""What recorded pushes do, predicted side by side: each object by itself, in its own frame, stepped by distance."""

import functools

import numpy as np
import torch
from jaxtyping import Float, Int

from pushgraph import pose
from pushgraph.adaptation.pressure import feet
from pushgraph.adaptation.unknowns import NOMINAL, Unknowns
from pushgraph.body import Body
from pushgraph.graph.feet import BodyFeet
from pushgraph.graph.scene_batch import SceneBatch, batch_scenes, double
from pushgraph.graph.state import controls, start
from pushgraph.network.contract import Dynamics
from pushgraph.real_pushes import DEEPEST, RealPushes, depths
from pushgraph.scene import NOMINAL_MASS, Scene
from pushgraph.scene_parts import SceneInParts, in_parts
from pushgraph.shape import BodyShape
from pushgraph.tool import Tool
from pushgraph.track import FRAME

LONGEST_STEP = 0.0075
"""A step covers so much of the probe's way (m)."""
PARTED = 1e-6
"""A probe that is measured to start inside the object starts so far outside of it (m)."""
NEAR = 0.05
"""Gaps are exact where they are less (m)."""


def predicted_motion(
    dynamics: Dynamics, pushes: RealPushes, unknowns: Unknowns = NOMINAL, longest_step: float = LONGEST_STEP
) -> Float[np.ndarray, "pushes 3"]:
    """pose_before_from_after of each push: how its object moves, in its own frame before (m, rad).

    unknowns: of all pushes, or a row for each.
    """
    rows = np.broadcast_to(unknowns.scores, (len(pushes), len(NOMINAL)))
    found = np.zeros((len(pushes), 3))
    everything = Unknowns.of(rows)
    start, end = _probe_in_body(pushes, everything)
    grain = _grain_in_body(pushes, everything)
    for name in dict.fromkeys(pushes.shape.tolist()):
        chosen = np.flatnonzero(pushes.of(shape=name))
        found[chosen] = _of_one_shape(
            dynamics,
            pushes.shapes[name],
            pushes.probe_radius,
            (start[chosen], end[chosen]),
            grain[chosen],
            pushes.speed[chosen],
            Unknowns.of(rows[chosen]),
            longest_step,
        )
    return found


def contact_points(pushes: RealPushes, steps: int = 100) -> Float[np.ndarray, "pushes 2"]:
    """Where the probe's centre is as it first touches the object, in its frame (m); its end, if it never does."""
    start, end = pushes.start_in_body, pushes.end_in_body
    share = np.linspace(0, 1, steps)[:, None]
    ways = start[:, None] + share * (end - start)[:, None]
    touches = np.zeros(ways.shape[:2], dtype=bool)
    for name in dict.fromkeys(pushes.shape.tolist()):
        chosen = pushes.of(shape=name)
        depth = depths(pushes.shapes[name], ways[chosen].reshape(-1, 2)).reshape(-1, steps)
        touches[chosen] = depth > -pushes.probe_radius - 2e-4
    touches[:, -1] = True
    return ways[np.arange(len(ways)), touches.argmax(1)]


def _probe_in_body(
    pushes: RealPushes, unknowns: Unknowns
) -> tuple[Float[np.ndarray, "pushes 2"], Float[np.ndarray, "pushes 2"]]:
    """Where the probe starts and ends, in the frame of the object (m)."""
    offset = pose.rotate(np.stack((unknowns.probe_x, unknowns.probe_y), -1), -pushes.before[:, 2])
    return pushes.start_in_body + offset, pushes.end_in_body + offset


def _grain_in_body(pushes: RealPushes, unknowns: Unknowns) -> Float[np.ndarray, "pushes 2"]:
    """Anisotropy of the table, seen from the object; see SceneBatch."""
    of_grain = np.stack((unknowns.anisotropy_x, unknowns.anisotropy_y), -1)
    return pose.rotate(of_grain, -2 * pushes.before[:, 2])


def _of_one_shape(
    dynamics: Dynamics,
    shape: BodyShape,
    radius: float,
    way: tuple[np.ndarray, np.ndarray],
    grain: Float[np.ndarray, "pushes 2"],
    speed: Float[np.ndarray, " pushes"],
    unknowns: Unknowns,
    longest_step: float,
) -> Float[np.ndarray, "pushes 3"]:
    scene, apart, one = _alone(shape, radius)
    begin, end = _outside(scene, *way), way[1]
    count = len(begin)
    scenes = one.take(torch.zeros(count, dtype=torch.long))
    scenes = scenes._replace(
        side_friction=torch.from_numpy(np.array(unknowns.side_friction, dtype=float)),
        anisotropy=torch.from_numpy(grain),
    )
    pressures = np.stack((unknowns.concentration, unknowns.corner_share, unknowns.centre_x, unknowns.centre_y), -1)
    kinds, which = np.unique(pressures, axis=0, return_inverse=True)
    scenes = _pressing(scenes, apart, shape, kinds, which.reshape(-1))
    poses = torch.zeros(*scenes.mass.shape, 3, dtype=torch.float64)
    poses[:, : len(apart.scene.bodies)] = torch.from_numpy(apart.scene.poses_world_from_body)
    state = start(scenes, poses)
    length = np.hypot(*(end - begin).T)
    steps = max(1, int(np.ceil(length.max() / longest_step)))
    share = np.linspace(0, 1, steps + 1)[:, None]
    tool = np.zeros((count, steps + 1, 3))
    tool[..., :2] = begin[:, None] + share * (end - begin)[:, None]
    frames = torch.from_numpy(np.repeat((length / speed / FRAME / steps)[:, None], steps, 1))
    with torch.inference_mode():
        down = torch.ones(count, steps + 1, dtype=torch.bool)
        for control in controls(torch.from_numpy(tool), down, frames):
            state = state.observe(state.poses + dynamics(state, control).motion, control.frames)
        return apart.body_poses(state.poses.numpy())[:, 0]


@functools.lru_cache(maxsize=64)
@torch.inference_mode(False)
def _alone(shape: BodyShape, radius: float) -> tuple[Scene, SceneInParts, SceneBatch]:
    """A body of this shape alone on a table, at the origin, as a scene, in parts, and as tensors."""
    body = Body(name="object", shape=shape, pose_world_from_body=(0.0, 0.0, 0.0), mass=NOMINAL_MASS)
    scene = Scene(bodies=(body,), tool=Tool.round(2 * radius))
    apart = in_parts(scene)
    return scene, apart, double(batch_scenes([apart.scene]))


def _outside(
    scene: Scene, begin: Float[np.ndarray, "pushes 2"], end: Float[np.ndarray, "pushes 2"]
) -> Float[np.ndarray, "pushes 2"]:
    """The starts of the probe; those that are measured to lie inside the object moved back along their ways."""
    ahead = (end - begin) / np.hypot(*(end - begin).T)[:, None]
    back = np.zeros(len(begin))
    for _ in range(100):
        poses = np.pad(begin - back[:, None] * ahead, ((0, 0), (0, 1)))
        gap = scene.tool_gaps(poses, scene.poses_world_from_body)[:, 0]
        inside = (gap < 0) & (back < 3 * DEEPEST)
        if not inside.any():
            break
        back += np.where(inside, PARTED - gap, 0.0)
    return begin - back[:, None] * ahead


def _pressing(
    scenes: SceneBatch,
    apart: SceneInParts,
    shape: BodyShape,
    kinds: Float[np.ndarray, "kinds 4"],
    which: Int[np.ndarray, " pushes"],
) -> SceneBatch:
    """The same bodies, pressing as `kinds` of concentration, corner share and centre say; all of it is given to their
    first parts."""
    found = [feet(shape, c, share, (x, y)) for c, share, x, y in kinds.tolist()]
    to_part = pose.inverse(apart.scene.poses_world_from_body[0])
    points = np.stack([pose.transform(to_part, where) for where, _ in found])[which]
    shares = np.stack([share for _, share in found])[which]
    batch, parts = scenes.mass.shape
    first = torch.zeros(batch, parts, 1, dtype=torch.float64)
    first[:, 0] = 1.0
    at, share = torch.from_numpy(points)[:, None], torch.from_numpy(shares)[:, None]
    centre = (share[..., None] * at).sum(2)
    return scenes._replace(
        feet=BodyFeet(first[..., None] * at, first * share, torch.zeros(batch, parts, shares.shape[1]).double()),
        mass=torch.where(first[..., 0] > 0, NOMINAL_MASS, 1e-6).double(),
        centre_of_mass=first * centre,
    )
