"""Tables side by side on which pushes are made: predicted all at once, or simulated one after the other."""

import contextlib
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple, Protocol, runtime_checkable

import numpy as np
import torch
from jaxtyping import Float, Int

from pushgraph import pose
from pushgraph.contact import RoundedBox, signed_gap
from pushgraph.dataset.engines import single_threaded
from pushgraph.errors import EpisodeError, SimulationError
from pushgraph.graph.scene_batch import map_tensors
from pushgraph.graph.state import State
from pushgraph.physics import FEW, PhysicsPredictor
from pushgraph.scene import Scene
from pushgraph.scene_parts import SceneInParts, in_parts
from pushgraph.simulation.motion import LIFTED_FRAMES, plan_tool
from pushgraph.tool import Push

if TYPE_CHECKING:
    from pushgraph.simulation.planar import PlanarSimulation

Which = Int[np.ndarray, " some"]
"""Indices of some of the tables."""


class Nearest(NamedTuple):
    """What is nearest to a tool on each table: the signed gap (m), and the index of the body."""

    gap: Float[np.ndarray, " some"]
    body: Int[np.ndarray, " some"]


@runtime_checkable
class Tables(Protocol):
    """A number of tables, each with a scene.

    poses: pose_world_from_body now (float64); zero where a table has no such body.
    """

    poses: Float[np.ndarray, "tables bodies 3"]

    def begin(
        self, which: Which, scenes: Sequence[Scene], poses: Float[np.ndarray, "some bodies 3"] | None = None
    ) -> None:
        """Lay out scenes on some of the tables. poses: where their bodies are, if not where the scenes have them."""

    def nearest(self, which: Which, poses_world_from_tool: Float[np.ndarray, "some 3"]) -> Nearest:
        """What is nearest to the tool where it comes down."""

    def push(self, which: Which, pushes: Sequence[Push]) -> list[str | None]:
        """Make one push on each of some tables; says why one came to nothing, and bodies stay; None if it did not."""


class PredictedTables:
    """One batched rollout a push. Joints are carried by the state that the scenes were begun with.

    pool: all scenes that will ever be begun, if they are known: their states are then made once. If they are not, all
    must be of the same number of bodies, none of them a polygon, and push with tools of as many parts.
    """

    def __init__(
        self, count: int, bodies: int, predictor: PhysicsPredictor, pool: Sequence[Scene] | None = None
    ) -> None:
        self.poses = np.zeros((count, bodies, 3))
        self._predictor = predictor
        self._layouts: dict[int, SceneInParts] = {}
        self._state: State | None = None
        self._pool = None if pool is None else predictor.start(pool)
        self._rows = {id(scene): row for row, scene in enumerate(pool or ())}

    def begin(
        self, which: Which, scenes: Sequence[Scene], poses: Float[np.ndarray, "some bodies 3"] | None = None
    ) -> None:
        """See Tables."""
        if self._pool is None:
            state = self._predictor.start(scenes)
        else:
            state = self._pool.take(torch.tensor([self._rows[id(scene)] for scene in scenes]))
        for row, (table, scene) in enumerate(zip(which.tolist(), scenes, strict=True)):
            layout = self._layouts[table] = in_parts(scene)
            starts = scene.poses_world_from_body
            here = starts if poses is None else poses[row, : len(starts)]
            self.poses[table] = 0.0
            self.poses[table, : len(starts)] = here
            if poses is not None:
                of_parts = layout.scene.poses_world_from_body
                owner = layout.owner
                moved = pose.compose(here[owner], pose.compose(pose.inverse(starts)[owner], of_parts))
                state.poses[row, : len(owner)] = torch.from_numpy(moved)
        self._put(which, state)

    def nearest(self, which: Which, poses_world_from_tool: Float[np.ndarray, "some 3"]) -> Nearest:
        """See Tables."""
        state = self._take(which)
        scenes, tool = state.scenes, torch.from_numpy(poses_world_from_tool)
        part_poses = pose.compose(tool[:, None], scenes.pose_tool_from_part)
        between = pose.relative(state.poses[:, None], part_poses[:, :, None])
        bodies, parts = (
            RoundedBox(
                boxes.half_extents.unsqueeze(axis).expand(*between.shape[:-1], 2),
                boxes.radius.unsqueeze(axis).expand(between.shape[:-1]),
            )
            for boxes, axis in ((scenes.boxes, 1), (scenes.parts, 2))
        )
        there = scenes.part_present[:, :, None] & scenes.present[:, None]
        gap, nearest = signed_gap(bodies, parts, between).masked_fill(~there, torch.inf).amin(1).min(1)
        owners = (self._layouts[table].owner for table in which.tolist())
        return Nearest(gap.numpy(), np.array([owner[k] for owner, k in zip(owners, nearest.tolist(), strict=True)]))

    def push(self, which: Which, pushes: Sequence[Push]) -> list[str | None]:
        """See Tables."""
        layouts = [self._layouts[table] for table in which.tolist()]
        plans = [plan_tool([push], one.scene.tool)[0] for push, one in zip(pushes, layouts, strict=True)]
        # As in a track of several pushes: lifted above where the last one ended, then above where this one begins.
        begins = 1 + LIFTED_FRAMES
        ends = begins + np.array([len(plan) for plan in plans]) - 1
        frames = np.arange(ends.max() + 1)
        tool = np.stack([plan[np.clip(frames - begins, 0, len(plan) - 1)] for plan in plans])
        down = (frames >= begins) & (frames <= ends[:, None])
        state, rows, last = self._take(which), torch.arange(len(plans)), torch.from_numpy(ends)
        with torch.no_grad(), single_threaded() if len(plans) < FEW else contextlib.nullcontext():
            predicted = self._predictor.rollout(state, torch.from_numpy(tool), torch.from_numpy(down)).poses
            moved = state._replace(poses=predicted[rows, last - 1]).observe(predicted[rows, last])
        finite = moved.poses.isfinite().all(-1).all(-1)
        self._put(which[finite.numpy()], moved.take(finite.nonzero()[:, 0]))
        for row in finite.nonzero()[:, 0].tolist():
            here = layouts[row].body_poses(moved.poses[row].numpy())
            self.poses[which[row], : len(here)] = here
        return [None if fine else "the prediction is not finite" for fine in finite.tolist()]

    def _take(self, which: Which) -> State:
        if self._state is None:
            raise EpisodeError("nothing stands on the tables: call reset first")
        return self._state.take(torch.from_numpy(which))

    def _put(self, which: Which, state: State) -> None:
        if self._state is None:
            self._state = state
        index = torch.from_numpy(which)
        self._state = map_tensors(lambda all_, some: all_.index_copy(0, index, some), self._state, state)


class SimulatedTables:
    """MuJoCo, one table after the other."""

    def __init__(self, count: int, bodies: int) -> None:
        self.poses = np.zeros((count, bodies, 3))
        self._simulations: dict[int, PlanarSimulation] = {}

    def begin(
        self, which: Which, scenes: Sequence[Scene], poses: Float[np.ndarray, "some bodies 3"] | None = None
    ) -> None:
        """See Tables; raises EpisodeError if poses are given."""
        if poses is not None:
            raise EpisodeError("poses: a simulation begins where its scene stands; only learned dynamics can elsewhere")
        from pushgraph.simulation.planar import PlanarSimulation  # here, so that learned dynamics do without MuJoCo

        for table, scene in zip(which.tolist(), scenes, strict=True):
            self._simulations[table] = PlanarSimulation(scene)
            self.poses[table] = 0.0
            self.poses[table, : len(scene.bodies)] = scene.poses_world_from_body

    def nearest(self, which: Which, poses_world_from_tool: Float[np.ndarray, "some 3"]) -> Nearest:
        """See Tables."""
        gaps = [self._gaps(table, tool) for table, tool in zip(which.tolist(), poses_world_from_tool, strict=True)]
        return Nearest(np.array([gap.min() for gap in gaps]), np.array([int(gap.argmin()) for gap in gaps]))

    def push(self, which: Which, pushes: Sequence[Push]) -> list[str | None]:
        """See Tables."""
        return [self._push(table, push) for table, push in zip(which.tolist(), pushes, strict=True)]

    def _gaps(self, table: int, pose_world_from_tool: Float[np.ndarray, "3"]) -> Float[np.ndarray, " bodies"]:
        scene = self._simulations[table].scene
        return scene.tool_gaps(pose_world_from_tool[None], self.poses[table, : len(scene.bodies)])[0]

    def _push(self, table: int, push: Push) -> str | None:
        try:
            self._simulations[table].push(push)
        except SimulationError as error:
            return str(error)
        here = self._simulations[table].poses
        self.poses[table, : len(here)] = here
        return None
