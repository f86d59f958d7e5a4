"""One call to plan: straight pushes of the scene's tool, or the best of several tools and given pushes."""

import functools
from collections.abc import Callable, Sequence

import numpy as np

from pushgraph.errors import PlanningError
from pushgraph.physics import PhysicsPredictor
from pushgraph.planning.admissible import Reach
from pushgraph.planning.costs import cost_of
from pushgraph.planning.dynamics import Dynamics, learned
from pushgraph.planning.exhaustive import plan_exhaustively
from pushgraph.planning.goal import Goal
from pushgraph.planning.plan import Plan
from pushgraph.planning.risk import Risk, as_predicted
from pushgraph.planning.sampling import Sampling, plan_continuously
from pushgraph.planning.tools import NamedTool
from pushgraph.scene import Scene
from pushgraph.tool import Push


def plan(
    scene: Scene,
    goal: Goal,
    dynamics: Dynamics | None = None,
    tools: Sequence[NamedTool] = (),
    pushes: Sequence[Push] = (),
    rng: np.random.Generator | None = None,
    sampling: Sampling | None = None,
    risk: Risk = as_predicted,
    reach: Reach | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Plan:
    """The pushes that bring the goal's body nearest to where it shall be, ready to be run by a robot.

    dynamics: says what pushes do; the shipped predictor by default, which states the spread, too. tools: to choose
    from; the scene's own by default. pushes: if given, every tool is tried with each of them, see `plan_exhaustively`;
    otherwise straight pushes are drawn from `rng` and improved, see `plan_continuously`, which tells what sampling,
    risk and progress are. reach: says what an arm cannot do. The pushes that the scene holds are of no matter.
    Raises PlanningError if the goal does not fit the scene, or nothing may be tried.
    """
    goal.check(scene)
    dynamics = learned(_shipped(), spread=True) if dynamics is None else dynamics
    if pushes:
        if not tools:
            raise PlanningError("pushes: need tools to be tried with; pushgraph.planning.tools.load_tools reads some")
        return plan_exhaustively(scene, cost_of(scene, goal), dynamics, tools, pushes, reach, progress)
    rng = np.random.default_rng(0) if rng is None else rng
    if not tools:
        return plan_continuously(scene, goal, dynamics, rng, sampling, risk, reach, progress)
    plans = []
    for k, tool in enumerate(tools):
        with_tool = scene.model_copy(update={"tool": tool.tool})
        of_tool = functools.partial(_of_tool, progress, k, len(tools))
        planned = plan_continuously(with_tool, goal, dynamics, rng, sampling, risk, reach, of_tool)
        plans.append(Plan(tool.name, planned.scene, planned.expected, planned.cost))
    return min(plans, key=lambda each: each.cost)


def _of_tool(progress: Callable[[int, int], None], tool: int, tools: int, done: int, total: int) -> None:
    progress(tool * total + done, tools * total)


@functools.cache
def _shipped() -> PhysicsPredictor:
    return PhysicsPredictor.load()
