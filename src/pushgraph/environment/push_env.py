"""The environment, one table or many."""

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils.seeding import np_random
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from jaxtyping import Bool, Float, UInt8

from pushgraph.environment import PUSHES
from pushgraph.environment.episodes import Episodes, action_space
from pushgraph.environment.observation import Observation
from pushgraph.errors import EpisodeError
from pushgraph.physics import PhysicsPredictor
from pushgraph.planning.goal import Goal
from pushgraph.scene import Scene
from pushgraph.tool import Push

RENDER_MODES = ["rgb_array"]
ONLY = np.array([0])


class PushEnv(gymnasium.Env[dict[str, Any], np.ndarray]):
    """Bring a body to its goal.

    scenes: the name of a setup, a scene is drawn of it for each episode; or a scene; or several, of which each episode
    draws one. objects: how many a setup draws. dynamics: "learned", "mujoco", or a predictor. goal: by default each
    episode draws one, goal_yaw: with a yaw. longest_push: m. speed: of pushes (m/s).

    Observations: see `pushgraph.environment.observation`. Action: where the tool comes down, as a share of half the
    table's size along its x and y, and which way it goes, as a share of the longest push along x and y. Reward: how
    much nearer the goal's body came to it (m, turns counted as in `pushgraph.planning.costs`). A push that comes down
    on a body or leaves the table is refused: nothing moves, and it costs REFUSED. Terminated: the goal is reached, or a
    body left the table. Truncated: after `max_episode_steps`, or where the dynamics fail.

    info: distance (m) and turn (rad) to the goal, success, left_table, and why the push was refused, "" if it was not.
    `reset(options={"poses": ...})` begins with the bodies there, joints as in the scene (learned dynamics only).
    """

    metadata = {"render_modes": RENDER_MODES, "render_fps": 1}  # noqa: RUF012

    def __init__(
        self,
        scenes: str | Scene | Sequence[Scene] = "multiple-parts",
        objects: int = 9,
        dynamics: str | PhysicsPredictor = "learned",
        goal: Goal | None = None,
        goal_yaw: bool = False,
        longest_push: float = 0.30,
        speed: float = 0.2,
        render_mode: str | None = None,
    ) -> None:
        self._episodes = Episodes(1, scenes, objects, dynamics, goal, goal_yaw, longest_push, speed)
        self.observation_space, self.action_space = self._episodes.space, action_space()
        self.render_mode = _checked_mode(render_mode)

    @property
    def scene(self) -> Scene:
        """The scene of this episode, as it began."""
        return self._episodes.scenes[0]

    @property
    def goal(self) -> Goal:
        """The goal of this episode."""
        return self._episodes.goals[0]

    def push(self, action: Float[np.ndarray, "4"]) -> Push:
        """The push that an action means."""
        return self._episodes.push(0, action)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode; the same seed begins the same."""
        super().reset(seed=seed)
        info = self._episodes.begin(ONLY, [self.np_random], _poses(options))
        return self._observation(), _first(info)

    def step(self, action: np.ndarray) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Make one push."""
        reward, terminated, truncated, info = self._episodes.step(ONLY, np.asarray(action)[None])
        return self._observation(), float(reward[0]), bool(terminated[0]), bool(truncated[0]), _first(info)

    def render(self) -> UInt8[np.ndarray, "height width 3"] | None:
        """The table from above, if the render mode asks for it."""
        return None if self.render_mode is None else _render(self._episodes, 0)

    def _observation(self) -> Observation:
        return {name: values[0] for name, values in self._episodes.observe().items()}


class PushVectorEnv(VectorEnv[dict[str, Any], np.ndarray, np.ndarray]):
    """Many of `PushEnv`, all pushes of a step in one batched rollout. Arguments as there.

    Where an episode ended, the next step begins another whatever the action is (Gymnasium's autoreset "next step").
    With an integer seed table k behaves as a `PushEnv` with seed + k. `reset(options={"reset_mask": ...})` begins anew
    only there.
    """

    metadata = {  # noqa: RUF012
        "render_modes": RENDER_MODES,
        "render_fps": 1,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        num_envs: int = 1,
        scenes: str | Scene | Sequence[Scene] = "multiple-parts",
        objects: int = 9,
        dynamics: str | PhysicsPredictor = "learned",
        goal: Goal | None = None,
        goal_yaw: bool = False,
        longest_push: float = 0.30,
        speed: float = 0.2,
        render_mode: str | None = None,
        max_episode_steps: int = PUSHES,
    ) -> None:
        self._episodes = Episodes(num_envs, scenes, objects, dynamics, goal, goal_yaw, longest_push, speed)
        self.num_envs, self.render_mode = num_envs, _checked_mode(render_mode)
        self.single_observation_space, self.single_action_space = self._episodes.space, action_space()
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._max_episode_steps = max_episode_steps
        self._rngs: list[np.random.Generator] = [np_random()[0] for _ in range(num_envs)]
        self._steps = np.zeros(num_envs, dtype=int)
        self._over = np.ones(num_envs, dtype=bool)

    @property
    def scenes(self) -> tuple[Scene, ...]:
        """The scene of each table's episode, as it began."""
        return tuple(self._episodes.scenes[table] for table in range(self.num_envs))

    @property
    def goals(self) -> tuple[Goal, ...]:
        """The goal of each table's episode."""
        return tuple(self._episodes.goals[table] for table in range(self.num_envs))

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin episodes; the same seeds begin the same."""
        options = dict(options or {})
        mask = np.asarray(options.pop("reset_mask", np.ones(self.num_envs, dtype=bool)))
        if mask.shape != (self.num_envs,) or mask.dtype != bool or not mask.any():
            raise EpisodeError(f"reset_mask: must be {self.num_envs} booleans, one of them true; got {mask!r}")
        seeds = _seeds(seed, self.num_envs)
        which = np.flatnonzero(mask)
        for table in which.tolist():
            if seeds[table] is not None:
                self._rngs[table] = np_random(seeds[table])[0]
        info = self._begin(which, _poses(options))
        return self._episodes.observe(), self._spread(which, info)

    def step(
        self, actions: Float[np.ndarray, "tables 4"]
    ) -> tuple[
        Observation,
        Float[np.ndarray, " tables"],
        Bool[np.ndarray, " tables"],
        Bool[np.ndarray, " tables"],
        dict[str, Any],
    ]:
        """Make one push on every table, or begin anew where an episode ended."""
        actions = np.asarray(actions)
        again, which = np.flatnonzero(self._over), np.flatnonzero(~self._over)
        reward, terminated, truncated = (np.zeros(self.num_envs, dtype=kind) for kind in (float, bool, bool))
        infos: dict[str, Any] = {}
        if len(again):
            infos = self._spread(again, self._begin(again))
        if len(which):
            outcome = self._episodes.step(which, actions[which])
            self._steps[which] += 1
            reward[which], terminated[which] = outcome.reward, outcome.terminated
            truncated[which] = outcome.truncated | (self._steps[which] >= self._max_episode_steps)
            infos = self._spread(which, outcome.info, infos)
        self._over = terminated | truncated
        return self._episodes.observe(), reward, terminated, truncated, infos

    def render(self) -> tuple[np.ndarray, ...] | None:
        """Every table from above, if the render mode asks for it."""
        if self.render_mode is None:
            return None
        return tuple(_render(self._episodes, table) for table in range(self.num_envs))

    def _begin(self, which: np.ndarray, poses: np.ndarray | None = None) -> dict[str, np.ndarray]:
        self._steps[which], self._over[which] = 0, False
        return self._episodes.begin(which, [self._rngs[table] for table in which.tolist()], poses)

    def _spread(
        self, which: np.ndarray, info: dict[str, np.ndarray], infos: dict[str, Any] | None = None
    ) -> dict[str, Any]:
        """Info of some tables as rows of all, each with a mask that says whose they are, as Gymnasium has it."""
        infos = infos or {}
        for name, values in info.items():
            row = infos.setdefault(name, np.zeros(self.num_envs, dtype=values.dtype))
            mask = infos.setdefault(f"_{name}", np.zeros(self.num_envs, dtype=bool))
            row[which], mask[which] = values, True
        return infos


def _seeds(seed: int | Sequence[int | None] | None, count: int) -> list[int | None]:
    if seed is None:
        return [None] * count
    if isinstance(seed, int):
        return [seed + k for k in range(count)]
    if len(seed) != count:
        raise EpisodeError(f"seed: needs one for each of {count} tables, got {len(seed)}")
    return list(seed)


def _poses(options: dict[str, Any] | None) -> np.ndarray | None:
    options = dict(options or {})
    poses = options.pop("poses", None)
    if options:
        raise EpisodeError(f"options: no {', '.join(map(repr, options))}; valid: poses, and reset_mask for many tables")
    return poses


def _first(info: dict[str, np.ndarray]) -> dict[str, Any]:
    return {name: values.tolist()[0] for name, values in info.items()}


def _checked_mode(render_mode: str | None) -> str | None:
    if render_mode not in (None, *RENDER_MODES):
        raise EpisodeError(f"render_mode: must be {', '.join(RENDER_MODES)} or None, got {render_mode!r}")
    return render_mode


def _render(episodes: Episodes, table: int) -> UInt8[np.ndarray, "height width 3"]:
    from pushgraph.viewer.snapshot import draw_snapshot  # here, so that what is not shown does without the viewer

    scene = episodes.scenes[table]
    poses = np.vstack((episodes.tool[table], episodes.tables.poses[table, : len(scene.bodies)]))
    return draw_snapshot(scene, poses, episodes.goals[table])
