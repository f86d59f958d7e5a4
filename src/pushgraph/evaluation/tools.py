"""The suite `tools`: choose a tool and pushes that bring a cylinder to a goal, with learned and simulated dynamics."""

import functools
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from pushgraph.dataset.engines import run_in_processes
from pushgraph.errors import ArmError, EvaluationError, PlanningError
from pushgraph.evaluation.results import Results
from pushgraph.evaluation.tool_tasks import Start, candidates_of, goals_of_starts, simulated_start, start_scenes
from pushgraph.physics import PhysicsPredictor
from pushgraph.planning.costs import Cost, position_cost
from pushgraph.planning.dynamics import Dynamics, learned, simulated
from pushgraph.planning.plan import Plan
from pushgraph.planning.reach import arm_reach
from pushgraph.planning.tools import TOOLS
from pushgraph.scene import Scene
from pushgraph.simulation.arm import simulate_with_arm
from pushgraph.simulation.arm_planning import import_mink
from pushgraph.simulation.planar import simulate
from pushgraph.simulation.setups import FIRST_TEST_SEED
from pushgraph.track import Track

ALL = "all"
NEAR_ENOUGH = 0.02
"""Closed loop: the cylinder is nearer to its goal than this (m), or there is another plan."""
REPLANS = 2
REST = 0.2
"""After an executed plan the tool rests (s): what still slides comes to rest."""
SUCCESSES = {"success_5cm": 0.05, "success_10cm": 0.10}


@dataclass(frozen=True)
class Attempt:
    """What came of one task with one tool, or the best of all.

    error: final distance from the goal (m); that of the start, if no plan may be tried.
    """

    task: int
    model: str
    tool: str
    executed: str
    loop: str
    error: float


@dataclass(frozen=True, eq=False)
class ToolMeasures:
    """All attempts, and how long plans took (s), by model."""

    tasks: int
    attempts: Sequence[Attempt]
    planning: Sequence[tuple[str, float]]


def evaluate_tools(
    count: int | None,
    seed: int,
    contact: str | os.PathLike = "contact",
    workers: int = 1,
    progress: Callable[[str, int, int], None] = lambda what, done, total: None,
) -> tuple[Results, ToolMeasures]:
    """Plan and execute `count` tasks spread over all, or all of them.

    contact: the checkpoint that predicts. progress: of what, how much of how much is done. Raises ArmError if the extra
    of the arm is not installed.
    """
    if seed < FIRST_TEST_SEED:
        raise EvaluationError(f"seed {seed}: seeds below {FIRST_TEST_SEED:,} are for training and validation data")
    import_mink()  # a plan that an arm cannot make is a failure, a missing package is none
    goals = goals_of_starts(seed, workers, functools.partial(progress, "starts"))
    tasks = [(index, goal) for index, number in enumerate(goals) for goal in range(number)]
    every = np.linspace(0, len(tasks) - 1, min(count or len(tasks), len(tasks))).round().astype(int)
    chosen = [tasks[k] for k in every]
    jobs: list[Job] = []
    for index in dict.fromkeys(index for index, _ in chosen):
        of_start = tuple((number, goal) for number, (at, goal) in enumerate(chosen) if at == index)
        jobs.append(Job(seed, index, of_start, str(contact), timed=not jobs))
    attempts: list[Attempt] = []
    planning: list[tuple[str, float]] = []
    for done, (_, (some, seconds)) in enumerate(run_in_processes(_measure_start, jobs, workers), start=1):
        attempts += some
        planning += seconds
        progress("plans", done, len(jobs))
    attempts.sort(key=lambda one: one.task)
    measures = ToolMeasures(len(chosen), attempts, planning)
    return _results(measures, seed), measures


class Job(NamedTuple):
    """The tasks of one start: their numbers, and which of its goals. timed: whether to simulate all plans anew, too."""

    seed: int
    start: int
    tasks: tuple[tuple[int, int], ...]
    contact: str
    timed: bool


def _measure_start(job: Job) -> tuple[list[Attempt], list[tuple[str, float]]]:
    seed, index, tasks, contact, timed = job
    start = simulated_start(start_scenes(seed)[index])
    dynamics = learned(PhysicsPredictor.load(contact))
    dynamics(start.candidates.plans[:1])  # compiles, where nothing is compiled yet
    begun = time.perf_counter()
    predicted = dynamics(candidates_of(start.scene).plans)
    seconds = [("learned", time.perf_counter() - begun)]
    if timed:
        begun = time.perf_counter()
        simulated(candidates_of(start.scene).plans)
        seconds.append(("mujoco", time.perf_counter() - begun))
    bench = _Bench(start, dynamics)
    attempts: list[Attempt] = []
    for task, goal in tasks:
        attempts += bench.attempts(task, "learned", start.goals[goal], predicted, replans=REPLANS, arm=True)
        attempts += bench.attempts(task, "mujoco", start.goals[goal], start.tracks)
    return attempts, seconds


class _Bench:
    """Tries the tasks of one start."""

    def __init__(self, start: Start, dynamics: Dynamics) -> None:
        self.start, self.dynamics = start, dynamics
        self.executed = functools.cache(_executed)
        tools, plans = start.candidates.tools, start.candidates.plans
        self.of_tool = {name: [k for k, tool in enumerate(tools) if tool == name] for name in TOOLS}
        self.of_tool[ALL] = list(range(len(plans)))
        self.in_reach = [k for k, plan in enumerate(plans) if arm_reach(plan, plan.pushes[0]) is None]

    def attempts(
        self, task: int, model: str, place: np.ndarray, tracks: Sequence[Track], replans: int = 0, arm: bool = False
    ) -> list[Attempt]:
        """One task with every tool alone and with all. replans: 0 leaves the closed loop out."""
        cost = position_cost(self.start.scene, "object", *place.tolist())
        found = []
        for tool, which in self.of_tool.items():
            plan = self._plan(which, tracks, cost)
            errors = [_distance(self.start.scene if plan is None else self.executed(plan.scene), place)]
            found.append(Attempt(task, model, tool, "predicted", "open", errors[0] if plan is None else plan.cost))
            found.append(Attempt(task, model, tool, "tool", "open", errors[0]))
            if replans:
                closed = errors[0] if plan is None else self._closed_loop(plan, tool, place, cost, replans)
                found.append(Attempt(task, model, tool, "tool", "closed", closed))
        if arm:
            by_arm = self._plan(self.in_reach, tracks, cost)
            found.append(Attempt(task, model, ALL, "arm", "open", self._error_of_arm(by_arm, place)))
        return found

    def _plan(self, which: Sequence[int], tracks: Sequence[Track], cost: Cost) -> Plan | None:
        """The best of these plans; None if there are none."""
        try:
            candidates, some = self.start.candidates.only(which, tracks)
        except PlanningError:
            return None
        return candidates.best(some, cost)

    def _closed_loop(self, plan: Plan, tool: str, place: np.ndarray, cost: Cost, replans: int) -> float:
        """Distance from the goal after a plan and others after it; the tool comes down where it came down first."""
        scene = self.executed(plan.scene)
        for _ in range(replans if plan.pushes else 0):
            error = _distance(scene, place)
            if error <= NEAR_ENOUGH:
                break
            try:
                candidates = candidates_of(scene, tool)
            except PlanningError:
                break
            again = candidates.best(self.dynamics(candidates.plans), cost)
            if again.cost >= error:
                break
            scene = self.executed(again.scene)
        return _distance(scene, place)

    def _error_of_arm(self, plan: Plan | None, place: np.ndarray) -> float:
        """Distance from the goal as the arm executes a plan; that of the start, if it cannot."""
        if plan is not None and plan.pushes:
            try:
                end = simulate_with_arm(_resting(plan.scene)).track.poses[-1, 1]
                return float(np.hypot(*(end[:2] - place)))
            except ArmError:
                pass
        return _distance(self.start.scene, place)


def _executed(plan: Scene) -> Scene:
    """The scene after a plan, as simulated."""
    if not plan.pushes:
        return plan
    (body,) = plan.bodies
    end = simulate(_resting(plan)).poses[-1, 1]
    moved = body.replace(pose_world_from_body=tuple(end.tolist()))
    return plan.model_copy(update={"bodies": (moved,), "pushes": ()})


def _resting(plan: Scene) -> Scene:
    """The plan with a rest after its push."""
    return plan.model_copy(update={"pushes": tuple(push.replace(rest=REST) for push in plan.pushes)})


def _distance(scene: Scene, place: np.ndarray) -> float:
    return float(np.hypot(*(scene.poses_world_from_body[0, :2] - place)))


def _results(measures: ToolMeasures, seed: int) -> Results:
    protocol = {"setup": "tools", "count": measures.tasks, "seed": seed, "replans": REPLANS}
    results = Results("tools", protocol, ("tool", "executed", "loop"))
    names = (*TOOLS, ALL)
    kinds = {(one.model, one.loop, one.executed, one.tool) for one in measures.attempts}
    for model, loop, executed, tool in sorted(kinds, key=lambda kind: (*kind[:3], names.index(kind[3]))):
        some = [
            one
            for one in measures.attempts
            if (one.model, one.tool, one.executed, one.loop) == (model, tool, executed, loop)
        ]
        errors, tasks = np.array([one.error for one in some]), np.array([one.task for one in some])
        labels: dict[str, Any] = dict(tool=tool, executed=executed, loop=loop)
        results.add(model, "mean_error_cm", "cm", 100 * errors, tasks, **labels)
        for metric, enough in SUCCESSES.items():
            results.add(model, metric, "1", (errors < enough).astype(float), tasks, **labels)
        results.add(model, "tasks", "1", np.array([float(len(some))]), np.zeros(1, dtype=int), **labels)
    for model in dict.fromkeys(model for model, _ in measures.planning):
        seconds = np.array([took for name, took in measures.planning if name == model])
        labels = dict(tool=ALL, executed=ALL, loop="open")
        results.add(model, "planning_s", "s", seconds, np.arange(len(seconds)), **labels)
    return results
