"""Episodes side by side: scenes and goals drawn, pushes made or refused, and what they are worth."""

import math
from collections.abc import Sequence
from typing import NamedTuple, cast

import numpy as np
from gymnasium import spaces
from gymnasium.vector.utils import create_empty_array
from jaxtyping import Bool, Float

from pushgraph import pose
from pushgraph.environment.observation import Observation, describe, observation_space, shown_poses
from pushgraph.environment.tables import PredictedTables, SimulatedTables, Tables, Which
from pushgraph.errors import EpisodeError
from pushgraph.physics import PhysicsPredictor
from pushgraph.planning.admissible import CLEARANCE
from pushgraph.planning.costs import TURN_ARM
from pushgraph.planning.goal import Goal, index_of
from pushgraph.scene import Scene
from pushgraph.simulation.setups import EPISODIC, SETUPS, draw_setup
from pushgraph.tool import Push

DYNAMICS = ("learned", "mujoco")
REFUSED = 0.05
"""What a push costs that is refused (m)."""
GOAL_DISTANCE = (0.10, 0.30)
"""Goals are drawn so far from where the body stands (m)."""
GOAL_MARGIN = 0.15
"""And at least so far from the edges of the table (m)."""


class Outcome(NamedTuple):
    """What became of a push on each of some tables; see `PushEnv`."""

    reward: Float[np.ndarray, " some"]
    terminated: Bool[np.ndarray, " some"]
    truncated: Bool[np.ndarray, " some"]
    info: dict[str, np.ndarray]


class Episodes:
    """A number of tables, and the episode that goes on at each. For the arguments see `PushEnv`."""

    def __init__(
        self,
        count: int,
        scenes: str | Scene | Sequence[Scene],
        objects: int,
        dynamics: str | PhysicsPredictor,
        goal: Goal | None,
        goal_yaw: bool,
        longest_push: float,
        speed: float,
    ) -> None:
        self._setup, self._objects = _checked_setup(scenes, goal), objects
        self._pool = None if isinstance(scenes, str) else _pool(scenes, goal)
        self._goal, self._goal_yaw = goal, goal_yaw
        self._longest_push, self._speed = longest_push, speed
        bodies = max(len(scene.bodies) for scene in self._pool) if self._pool else objects
        parts = max(len(scene.tool.parts) for scene in self._pool) if self._pool else 1
        self.space = observation_space(bodies, parts)
        self.tables = _tables(dynamics, count, bodies, self._pool)
        self.scenes: dict[int, Scene] = {}
        self.goals: dict[int, Goal] = {}
        self._shown = cast(Observation, create_empty_array(self.space, count, np.zeros))
        self._target = np.zeros(count, dtype=int)
        self.tool = np.full((count, 3), np.nan)
        """Where the last push ended on each table, pose_world_from_tool; NaN before the first."""

    def begin(
        self, which: Which, rngs: Sequence[np.random.Generator], poses: Float[np.ndarray, "..."] | None = None
    ) -> dict[str, np.ndarray]:
        """Begin anew on some tables, each with its own generator; returns what Gymnasium calls info.

        poses: [bodies 3] for all of them, or [some bodies 3]: where the bodies are, if not where the scenes have them.
        """
        scenes = [self._draw_scene(rng) for rng in rngs]
        if poses is not None:
            poses = self._checked(np.asarray(poses, dtype=float), len(which))
        self.tables.begin(which, scenes, poses)
        for table, scene, rng in zip(which.tolist(), scenes, rngs, strict=True):
            goal = self._goal or draw_goal(scene, rng, self._goal_yaw)
            self.scenes[table], self.goals[table] = scene, goal
            self._target[table] = index_of(scene, goal.body)
            describe(scene, goal, {name: values[table] for name, values in self._shown.items()})
        self.tool[which] = np.nan
        self._shown["poses"][which] = shown_poses(self.tables.poses[which])
        return self._info(which, [""] * len(which))

    def observe(self) -> Observation:
        """What is seen of every table now."""
        return {name: values.copy() for name, values in self._shown.items()}

    def step(self, which: Which, actions: Float[np.ndarray, "some 4"]) -> Outcome:
        """Make one push on each of some tables."""
        before = self._cost(which)
        pushes = [self.push(table, action) for table, action in zip(which.tolist(), actions, strict=True)]
        refused = self._refusals(which, pushes)
        made = [row for row, why in enumerate(refused) if not why]
        failed = np.zeros(len(which), dtype=bool)
        if made:
            faults = self.tables.push(which[made], [pushes[row] for row in made])
            for row, fault in zip(made, faults, strict=True):
                refused[row], failed[row] = fault or "", fault is not None
                self.tool[which[row]] = pushes[row].waypoints[-1]
            self._shown["poses"][which] = shown_poses(self.tables.poses[which])
        info = self._info(which, refused)
        cost = np.array([bool(why) for why in refused]) * REFUSED
        return Outcome(before - self._cost(which) - cost, info["success"] | info["left_table"], failed, info)

    def push(self, table: int, action: Float[np.ndarray, "4"]) -> Push:
        """The push that an action means on a table."""
        x, y, along, across = np.clip(np.asarray(action, dtype=float), -1.0, 1.0).tolist()
        top = self.scenes[table].table
        place = np.asarray(top.pose_world_from_table, dtype=float)
        start = pose.transform(place, np.array([x, y]) * np.array(top.size) / 2)
        share = min(math.hypot(along, across), 1.0)
        return Push(
            start=tuple(start.tolist()),
            direction=math.atan2(across, along) + float(place[2]),
            distance=share * self._longest_push,
            yaw=float(place[2]),
            speed=self._speed,
        )

    def _refusals(self, which: Which, pushes: Sequence[Push]) -> list[str]:
        """Why each push is not made; empty if it is."""
        waypoints = np.stack([push.waypoints for push in pushes])
        nearest = self.tables.nearest(which, waypoints[:, 0])
        said = []
        for table, push, gap, body in zip(which.tolist(), waypoints, nearest.gap, nearest.body, strict=True):
            scene = self.scenes[table]
            clearance = CLEARANCE if scene.clearance is None else scene.clearance
            why = ""
            if gap < clearance:
                why = f"the tool would come down {1e3 * gap:.0f} mm from body {scene.names[body]!r}"
            elif not scene.table.holds(push[1:, :2]).all():
                why = "the end-effector would leave the table"
            said.append(why)
        return said

    def _cost(self, which: Which) -> Float[np.ndarray, " some"]:
        """How far each goal's body is from where it shall be (m); as `pushgraph.planning.costs.pose_cost` has it."""
        distance, turn = self._errors(which)
        return np.hypot(distance, 2 * TURN_ARM * np.sin(turn / 2))

    def _errors(self, which: Which) -> Float[np.ndarray, "2 some"]:
        here = self.tables.poses[which, self._target[which]]
        pairs = [self.goals[table].error(one) for table, one in zip(which.tolist(), here, strict=True)]
        return np.array(pairs).reshape(-1, 2).T

    def _info(self, which: Which, refused: Sequence[str]) -> dict[str, np.ndarray]:
        distance, turn = self._errors(which)
        tolerance = np.array([[self.goals[k].tolerance, self.goals[k].yaw_tolerance] for k in which.tolist()])
        return {
            "distance": distance,
            "turn": turn,
            "success": (distance <= tolerance[:, 0]) & (turn <= tolerance[:, 1]),
            "left_table": np.array([self._left_table(table) for table in which.tolist()], dtype=bool),
            "refused": np.array(refused, dtype=object),
        }

    def _left_table(self, table: int) -> bool:
        scene = self.scenes[table]
        here = self.tables.poses[table, : len(scene.bodies)]
        return not (scene.on_table(here) | scene.immovable).all()

    def _draw_scene(self, rng: np.random.Generator) -> Scene:
        if self._pool is None:
            return draw_setup(self._setup, self._objects, rng)
        return self._pool[int(rng.integers(len(self._pool)))]

    def _checked(self, poses: Float[np.ndarray, "..."], count: int) -> Float[np.ndarray, "some bodies 3"]:
        wanted = self.tables.poses.shape[1:]
        if poses.shape not in (wanted, (count, *wanted)) or not np.isfinite(poses).all():
            raise EpisodeError(f"poses: must be finite, of shape {wanted} or {(count, *wanted)}; got {poses.shape}")
        return np.broadcast_to(poses, (count, *wanted))


def draw_goal(scene: Scene, rng: np.random.Generator, with_yaw: bool) -> Goal:
    """A movable body, and a place on the table that is not far from it; raises EpisodeError if there is none."""
    movable = np.flatnonzero(~scene.immovable)
    if not len(movable):
        raise EpisodeError("goal: no body of the scene can be moved")
    body = int(rng.choice(movable))
    place = np.asarray(scene.table.pose_world_from_table, dtype=float)
    half = np.maximum(np.array(scene.table.size) / 2 - GOAL_MARGIN, 0.0)
    distance = rng.uniform(*GOAL_DISTANCE)
    direction = rng.uniform(-math.pi, math.pi)
    wanted = scene.poses_world_from_body[body, :2] + distance * np.array([math.cos(direction), math.sin(direction)])
    on_table = np.clip(pose.transform(pose.inverse(place), wanted), -half, half)
    yaw = float(rng.uniform(-math.pi, math.pi)) if with_yaw else None
    return Goal(body=scene.names[body], position=tuple(pose.transform(place, on_table).tolist()), yaw=yaw)


def action_space() -> spaces.Box:
    """Where the tool comes down, in halves of the table, and how far it goes along x and y, in longest pushes."""
    return spaces.Box(-1.0, 1.0, (4,), np.float32)


def _checked_setup(scenes: str | Scene | Sequence[Scene], goal: Goal | None) -> str:
    """Empty if the scenes are given."""
    if not isinstance(scenes, str):
        return ""
    if scenes not in EPISODIC:
        valid = ", ".join(name for name in SETUPS if name in EPISODIC)
        raise EpisodeError(f"scenes: no setup {scenes!r}; valid: {valid}, a scene, or several")
    if goal is not None:
        raise EpisodeError("goal: a setup's scenes differ, so each episode draws its goal; give scenes to fix one")
    return scenes


def _pool(scenes: Scene | Sequence[Scene], goal: Goal | None) -> list[Scene]:
    pool = [scenes] if isinstance(scenes, Scene) else list(scenes)
    if not pool:
        raise EpisodeError("scenes: needs one at least")
    if goal is not None:
        for scene in pool:
            goal.check(scene)
    return [scene.model_copy(update={"pushes": ()}) for scene in pool]


def _tables(dynamics: str | PhysicsPredictor, count: int, bodies: int, pool: Sequence[Scene] | None) -> Tables:
    if dynamics == "mujoco":
        return SimulatedTables(count, bodies)
    if isinstance(dynamics, PhysicsPredictor):
        return PredictedTables(count, bodies, dynamics, pool)
    if dynamics == "learned":
        return PredictedTables(count, bodies, PhysicsPredictor.load(), pool)
    raise EpisodeError(f"dynamics: must be one of {', '.join(DYNAMICS)}, or a predictor; got {dynamics!r}")
