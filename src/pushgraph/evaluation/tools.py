"""The suite `tools`: choose a tool and pushes that bring a cylinder to a goal, with learned and simulated dynamics."""

import functools
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pushgraph.dataset.engines import run_in_processes
from pushgraph.errors import EvaluationError, PlanningError
from pushgraph.evaluation.results import Results
from pushgraph.evaluation.tool_tasks import Start, candidates_of, goals_of_starts, simulated_start, start_scenes
from pushgraph.physics import PhysicsPredictor
from pushgraph.planning.costs import Cost, position_cost
from pushgraph.planning.dynamics import Dynamics, learned, simulated
from pushgraph.planning.plan import Plan
from pushgraph.planning.tools import TOOLS
from pushgraph.scene import Scene
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

    contact: the checkpoint that predicts. progress: of what, how much of how much is done.
    """
    if seed < FIRST_TEST_SEED:
        raise EvaluationError(f"seed {seed}: seeds below {FIRST_TEST_SEED:,} are for training and validation data")
    goals = goals_of_starts(seed, workers, functools.partial(progress, "starts"))
    tasks = [(index, goal) for index, number in enumerate(goals) for goal in range(number)]
    every = np.linspace(0, len(tasks) - 1, min(count or len(tasks), len(tasks))).round().astype(int)
    chosen = [tasks[k] for k in every]
    jobs = []
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
    executed = functools.cache(_executed)
    attempts: list[Attempt] = []
    for task, goal in tasks:
        place = start.goals[goal]
        for model, tracks in (("learned", predicted), ("mujoco", start.tracks)):
            attempts += _attempts(task, start, place, model, tracks, dynamics, executed)
    return attempts, seconds


def _attempts(
    task: int,
    start: Start,
    place: np.ndarray,
    model: str,
    tracks: Sequence[Track],
    dynamics: Dynamics,
    executed: Callable[[Scene], Scene],
) -> list[Attempt]:
    cost = position_cost(start.scene, "object", *place.tolist())
    still = float(np.hypot(*(start.scene.poses_world_from_body[0, :2] - place)))
    attempts = []
    for tool in (*TOOLS, ALL):
        try:
            candidates, some = start.candidates.of_tool(tool, tracks) if tool != ALL else (start.candidates, tracks)
            plan = candidates.best(some, cost)
        except PlanningError:
            attempts += [Attempt(task, model, tool, how, "open", still) for how in ("predicted", "tool")]
            attempts += [Attempt(task, model, tool, "tool", "closed", still)] * (model == "learned")
            continue
        scene = executed(plan.scene)
        errors = [_distance(scene, place)]
        attempts.append(Attempt(task, model, tool, "predicted", "open", plan.cost))
        attempts.append(Attempt(task, model, tool, "tool", "open", errors[0]))
        if model == "learned":
            for _ in range(REPLANS):
                again = _plan_again(scene, tool, dynamics, cost)
                if errors[-1] <= NEAR_ENOUGH or again is None or again.cost >= errors[-1]:
                    break
                scene = executed(again.scene)
                errors.append(_distance(scene, place))
            attempts.append(Attempt(task, model, tool, "tool", "closed", errors[-1]))
    return attempts


def _plan_again(scene: Scene, tool: str, dynamics: Dynamics, cost: Cost) -> Plan | None:
    """The tool is lifted, and comes down where it came down first; None if nothing may be tried."""
    try:
        candidates = candidates_of(scene, tool)
    except PlanningError:
        return None
    return candidates.best(dynamics(candidates.plans), cost)


def _executed(plan: Scene) -> Scene:
    """The scene after a plan, as simulated."""
    if not plan.pushes:
        return plan
    (push,), (body,) = plan.pushes, plan.bodies
    end = simulate(plan.model_copy(update={"pushes": (push.replace(rest=REST),)})).poses[-1, 1]
    moved = body.replace(pose_world_from_body=tuple(end.tolist()))
    return plan.model_copy(update={"bodies": (moved,), "pushes": ()})


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
        labels = dict(tool=tool, executed=executed, loop=loop)
        results.add(model, "mean_error_cm", "cm", 100 * errors, tasks, **labels)
        for metric, enough in SUCCESSES.items():
            results.add(model, metric, "1", errors < enough, tasks, **labels)
        results.add(model, "tasks", "1", np.array([len(some)]), np.zeros(1, dtype=int), **labels)
    for model in dict.fromkeys(model for model, _ in measures.planning):
        seconds = np.array([took for name, took in measures.planning if name == model])
        labels = dict(tool=ALL, executed=ALL, loop="open")
        results.add(model, "planning_s", "s", seconds, np.arange(len(seconds)), **labels)
    return results
