"""Push, look, correct what is believed, and plan again, until a body is where it shall be."""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from pushgraph.joint_doubt import Beliefs
from pushgraph.planning.goal import Goal, index_of
from pushgraph.planning.plan import Plan
from pushgraph.regulator import BeliefRegulator
from pushgraph.scene import Scene
from pushgraph.spread import Ellipse
from pushgraph.tool import Push
from pushgraph.track import Track

MOST_PUSHES = 8
SAMPLES = 200


@runtime_checkable
class Environment(Protocol):
    """Where pushes are made."""

    def execute(self, push: Push) -> Track:
        """Make a push; what was seen of it, from when the tool left where it was."""


Planner = Callable[[Scene, Goal, Beliefs], Plan]
"""Plans for a scene as it is believed to be; the beliefs say how sure its joints are."""


class SimulatedEnvironment:
    """A simulated table. noise: standard deviations of what is seen of a body: position (m), yaw (rad)."""

    def __init__(
        self, scene: Scene, noise: tuple[float, float] = (0.0, 0.0), rng: np.random.Generator | None = None
    ) -> None:
        from pushgraph.simulation.planar import PlanarSimulation  # here, so that real tables do without MuJoCo

        self.simulation = PlanarSimulation(scene.replace(pushes=()))
        self._spread = np.array([noise[0], noise[0], noise[1]])
        self._rng = np.random.default_rng(0) if rng is None else rng

    def execute(self, push: Push) -> Track:
        """See Environment."""
        before = self.simulation.track()
        seen = 0 if not before.scene.pushes else len(before.times)
        self.simulation.push(push)
        track = self.simulation.track()
        poses = track.poses[seen:].copy()
        poses[:, 1:] += self._rng.normal(size=poses[:, 1:].shape) * self._spread
        return Track(track.scene, track.times[seen:], poses, track.push[seen:], track.seen[seen:])


@dataclass(frozen=True)
class Step:
    """One push of a closed loop.

    plan: what was planned, of which the first push was made. expected: pose of the goal's body at the end of that push.
    region: where it is then with probability 0.68; likely: how likely it is then where it shall be; None if nothing
    states them. observed: its pose as seen. before, after: how far off it was (m, rad). planning: seconds.
    """

    plan: Plan
    expected: Float[np.ndarray, "3"]
    region: Ellipse | None
    likely: float | None
    observed: Float[np.ndarray, "3"]
    before: tuple[float, float]
    after: tuple[float, float]
    planning: float

    @property
    def push(self) -> Push:
        """What was done."""
        return self.plan.pushes[0]


def push_to_goal(
    regulator: BeliefRegulator,
    environment: Environment,
    goal: Goal,
    planner: Planner,
    pushes: int = MOST_PUSHES,
) -> Iterator[Step]:
    """Yield step after step, until the goal's body is where it shall be, or so many pushes were made.

    regulator: of the scene; what is believed so far; begun with the scene's poses if nothing was observed yet.
    Stops, too, where the planner has no push to make. Raises PlanningError if the goal does not fit the scene.
    """
    scene = regulator.original
    goal.check(scene)
    body = index_of(scene, goal.body)
    if not regulator.frames:
        regulator.observe(np.vstack((_away(scene), scene.poses_world_from_body)), down=False)
    for _ in range(pushes):
        believed = regulator.scene()
        now = believed.poses_world_from_body[body]
        if goal.reached(now):
            return
        begun = time.perf_counter()
        plan = planner(believed, goal, dict(zip(regulator.pairs, regulator.probabilities, strict=True)))
        planning = time.perf_counter() - begun
        if not plan.pushes:
            return
        seen = environment.execute(plan.pushes[0])
        for poses, down in seen.frames():
            regulator.observe(poses, down)
        end = int(np.flatnonzero(plan.expected.push == 0)[-1])
        observed = seen.poses[-1, 1 + body]
        yield Step(
            plan,
            plan.expected.poses[end, 1 + body],
            None if plan.expected.spread is None else plan.expected.spread.take((end, body)).ellipse(0.68),
            how_likely(plan, goal, end),
            observed,
            goal.error(now),
            goal.error(observed),
            planning,
        )


def how_likely(plan: Plan, goal: Goal, frame: int = -1) -> float | None:
    """Probability that the goal's body is where it shall be in a frame of what is expected."""
    if plan.expected.spread is None:
        return None
    body = index_of(plan.scene, goal.body)
    uniform = np.random.default_rng(0).random((SAMPLES, 3))
    errors = plan.expected.spread.take((frame, body)).errors(uniform)
    poses = plan.expected.poses[frame, 1 + body] + errors
    return float(np.mean([goal.reached(pose) for pose in poses]))


def _away(scene: Scene) -> Float[np.ndarray, "3"]:
    """A pose of the lifted tool."""
    return np.array(scene.table.pose_world_from_table, dtype=float)
