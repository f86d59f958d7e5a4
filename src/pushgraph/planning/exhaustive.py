"""Try every tool with every sequence of pushes, and take the best (paper, section IV)."""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from pushgraph.errors import PlanningError
from pushgraph.planning.admissible import Reach, admitted
from pushgraph.planning.costs import Cost
from pushgraph.planning.dynamics import Dynamics, body_poses
from pushgraph.planning.plan import Plan
from pushgraph.planning.tools import NamedTool
from pushgraph.scene import Scene
from pushgraph.tool import Push
from pushgraph.track import FRAME, Track

TOGETHER = 64
"""Plans that are tried side by side: those of one tool, as a rule."""


def plan_exhaustively(
    scene: Scene,
    cost: Cost,
    dynamics: Dynamics,
    tools: Sequence[NamedTool],
    pushes: Sequence[Push],
    reach: Reach | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Plan:
    """The tool and the push for which the cost is least, of all that may be tried; the plan ends in the best frame.

    pushes: the same for every tool, with `times`, so that they can end in any frame; see
    `pushgraph.planning.sequences`. progress: plans tried, of how many. Raises PlanningError if none may be tried: see
    `pushgraph.planning.admissible`.
    """
    candidates = Candidates.of(scene, tools, pushes, reach)
    tracks: list[Track] = []
    for first in range(0, len(candidates.plans), TOGETHER):
        tracks += dynamics(candidates.plans[first : first + TOGETHER])
        progress(len(tracks), len(candidates.plans))
    return candidates.best(tracks, cost)


class Candidates:
    """All plans that may be tried: every tool with every push. Their tracks serve any number of goals."""

    def __init__(self, tools: Sequence[str], plans: Sequence[Scene]) -> None:
        self.tools, self.plans = tools, plans

    @classmethod
    def of(
        cls, scene: Scene, tools: Sequence[NamedTool], pushes: Sequence[Push], reach: Reach | None = None
    ) -> "Candidates":
        """See `plan_exhaustively`."""
        names = [tool.name for tool in tools for _ in pushes]
        plans = [scene.model_copy(update={"tool": tool.tool, "pushes": (push,)}) for tool in tools for push in pushes]
        left = admitted(plans, reach)
        return cls([names[k] for k in left], [plans[k] for k in left])

    def only(self, which: Sequence[int], tracks: Sequence[Track]) -> tuple["Candidates", Sequence[Track]]:
        """Some of them, and their tracks; raises PlanningError if these are none."""
        if not which:
            raise PlanningError("none of the plans asked for may be tried")
        return Candidates([self.tools[k] for k in which], [self.plans[k] for k in which]), [tracks[k] for k in which]

    def best(self, tracks: Sequence[Track], cost: Cost) -> Plan:
        """The plan whose track comes to the least cost in any of its frames, ended there."""
        costs = costs_on_table(tracks, cost)
        best, frame = map(int, np.unravel_index(int(costs.argmin()), costs.shape))
        return self.ended(best, tracks[best], frame, float(costs[best, frame]))

    def ended(self, plan: int, track: Track, frame: int, cost: float) -> Plan:
        """One of the plans, ended in a frame."""
        frame = min(frame, len(track.times) - 1)
        push = self.plans[plan].pushes[0]
        scene = self.plans[plan].model_copy(update={"pushes": (push.until(frame * FRAME),) if frame else ()})
        spread = None if track.spread is None else track.spread.take(slice(frame + 1))
        kept = {name: getattr(track, name)[: frame + 1] for name in ("times", "poses", "push", "seen")}
        if not frame:
            kept["push"] = np.full(1, -1)
        return Plan(self.tools[plan], scene, Track(scene=scene, spread=spread, **kept), cost)


def costs_on_table(tracks: Sequence[Track], cost: Cost) -> Float[np.ndarray, "plans frames"]:
    """Costs in every frame; infinite from when a body leaves the table on."""
    poses = body_poses(tracks)
    costs = cost(poses).detach().numpy()
    scene = tracks[0].scene
    off = ~(scene.on_table(poses.numpy()) | scene.immovable).all(-1)
    return np.where(np.maximum.accumulate(off, axis=1), np.inf, costs)
