"""Plans that are not even tried: the tool comes down on a body, or leaves the table or the arm's reach."""

from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np

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
    found: list[str | None] = []
    starts: dict[tuple, str | None] = {}
    paths: dict[tuple, str | None] = {}
    for plan in plans:  # many begin alike, or go alike with other tools
        first = plan.pushes[0]
        start, path = (id(plan.tool), id(plan.bodies), first.start, first.yaw), (id(plan.table), *map(id, plan.pushes))
        if start not in starts:
            starts[start] = _comes_down_on(plan)
        if path not in paths:
            paths[path] = _leaves_table(plan)
        found.append(starts[start] or paths[path] or _out_of_reach(plan, reach))
    return found


def admitted(plans: Sequence[Scene], reach: Reach | None = None) -> list[int]:
    """Which plans may be tried; raises PlanningError, which says why, if none may."""
    why = refusals(plans, reach)
    left = [index for index, refusal in enumerate(why) if refusal is None]
    if not left:
        (reason, count), *_ = Counter(refusal for refusal in why if refusal is not None).most_common(1)
        raise PlanningError(f"none of {len(plans)} plans can be tried; of {count}: {reason}")
    return left


def _comes_down_on(plan: Scene) -> str | None:
    clearance = CLEARANCE if plan.clearance is None else plan.clearance
    first = plan.pushes[0]
    gaps = plan.tool_gaps(np.array([[*first.start, first.yaw]]), plan.poses_world_from_body)[0]
    if gaps.min() >= clearance:
        return None
    return (
        f"the tool would come down at ({first.start[0]:g}, {first.start[1]:g}) {1e3 * gaps.min():.0f} mm from body "
        f"{plan.names[int(gaps.argmin())]!r}; a clearance of {1e3 * clearance:g} mm is asked for"
    )


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
