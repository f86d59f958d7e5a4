"""Plans that are not even tried: the tool comes down on a body, or leaves the table or the arm's reach."""

from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from pushgraph.errors import PlanningError
from pushgraph.scene import Scene
from pushgraph.tool import Push

CLEARANCE = 0.005
"""The tool comes down this far from every body (m), unless the scene says otherwise."""
Reach = Callable[[Scene, Push], str | None]
"""Says why an arm cannot make a push; None if it can."""


def refusals(plans: Sequence[Scene], reach: Reach | None = None) -> list[str | None]:
    """Why each plan cannot be tried; None if it can. Of its first push only, where bodies are still where they were.

    reach: asked about every push, if given.
    """
    paths: dict[tuple, str | None] = {}
    for plan in plans:  # many go alike with other tools
        path = _path(plan)
        if path not in paths:
            paths[path] = _leaves_table(plan)
    return [
        fault or paths[_path(plan)] or _out_of_reach(plan, reach)
        for plan, fault in zip(plans, _coming_down(plans), strict=True)
    ]


def admitted(plans: Sequence[Scene], reach: Reach | None = None) -> list[int]:
    """Which plans may be tried; raises PlanningError, which says why, if none may."""
    why = refusals(plans, reach)
    left = [index for index, refusal in enumerate(why) if refusal is None]
    if not left:
        (reason, count), *_ = Counter(refusal for refusal in why if refusal is not None).most_common(1)
        raise PlanningError(f"none of {len(plans)} plans can be tried; of {count}: {reason}")
    return left


def _coming_down(plans: Sequence[Scene]) -> list[str | None]:
    """On what the tool of each plan would come down; each start of a tool among the same bodies is looked at once."""
    groups: dict[tuple[int, int], dict[tuple[float, float, float], list[int]]] = {}
    for k, plan in enumerate(plans):
        start = (*plan.pushes[0].start, plan.pushes[0].yaw)
        groups.setdefault((id(plan.tool), id(plan.bodies)), {}).setdefault(start, []).append(k)
    found: list[str | None] = [None] * len(plans)
    for starts in groups.values():
        scene = plans[next(iter(starts.values()))[0]]
        gaps = scene.tool_gaps(np.array(list(starts)), scene.poses_world_from_body)
        for of_start, with_it in zip(gaps, starts.values(), strict=True):
            for k in with_it:
                found[k] = _too_near(plans[k], of_start)
    return found


def _too_near(plan: Scene, gaps: Float[np.ndarray, " bodies"]) -> str | None:
    clearance = CLEARANCE if plan.clearance is None else plan.clearance
    if gaps.min() >= clearance:
        return None
    x, y = plan.pushes[0].start
    return (
        f"the tool would come down at ({x:g}, {y:g}) {1e3 * gaps.min():.0f} mm from body "
        f"{plan.names[int(gaps.argmin())]!r}; a clearance of {1e3 * clearance:g} mm is asked for"
    )


def _path(plan: Scene) -> tuple[int, ...]:
    return id(plan.table), *map(id, plan.pushes)


def _leaves_table(plan: Scene) -> str | None:
    for push in plan.pushes:
        off = ~plan.table.holds(push.waypoints[:, :2])
        if off.any():
            x, y, _ = push.waypoints[int(off.argmax())]
            return f"the end-effector would leave the table at ({x:.3g}, {y:.3g})"
    return None


def _out_of_reach(plan: Scene, reach: Reach | None) -> str | None:
    if reach is None:
        return None
    return next((why for push in plan.pushes if (why := reach(plan, push)) is not None), None)
