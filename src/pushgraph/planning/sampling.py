"""Plan straight pushes, drawn, tried, and drawn again around the best (cross-entropy method)."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pushgraph.errors import PlanningError
from pushgraph.planning.admissible import Reach, refusals
from pushgraph.planning.aims import Aims, aimed_pushes, first_aims
from pushgraph.planning.costs import cost_of
from pushgraph.planning.dynamics import Dynamics
from pushgraph.planning.goal import Goal, index_of
from pushgraph.planning.plan import Plan
from pushgraph.planning.risk import Risk, as_predicted
from pushgraph.scene import Scene
from pushgraph.simulation.motion import ToolMotion
from pushgraph.tool import Push
from pushgraph.track import FRAME, LIFTED, Track

OWN_TOOL = "own"
"""Name of the tool that a scene has."""


@dataclass(frozen=True)
class Sampling:
    """How much is tried.

    candidates: first draws. rounds: how often it is drawn again around the best. varied: how many each time. elites:
    how many the best are. scale: of the first such draws, see `Aims.varied`; it halves every time. pushes: at most,
    with the tool lifted between. branches: plans that are tried to their end, and gone on with if there may be more
    pushes. speed: m/s. longest: of a push (m). seconds: what is not tried by then is left out; None: all is tried.
    """

    candidates: int = 32
    rounds: int = 2
    varied: int = 16
    elites: int = 4
    scale: float = 0.25
    pushes: int = 1
    branches: int = 3
    speed: float = 0.2
    longest: float = 0.45
    seconds: float | None = None

    def __post_init__(self) -> None:
        for name in ("candidates", "varied", "elites", "pushes", "branches"):
            if getattr(self, name) < 1:
                raise PlanningError(f"sampling: {name} must be at least 1, got {getattr(self, name)}")


class Tried(NamedTuple):
    """A plan with what came of it. frame: in which it is best. cost: then (m)."""

    aim: Aims
    scene: Scene
    track: Track
    frame: int
    cost: float


def plan_continuously(
    scene: Scene,
    goal: Goal,
    dynamics: Dynamics,
    rng: np.random.Generator,
    sampling: Sampling | None = None,
    risk: Risk = as_predicted,
    reach: Reach | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Plan:
    """The straight pushes of the scene's tool that bring the goal's body nearest to where it shall be.

    risk: what of the goal's cost is made least; see `pushgraph.planning.risk`. progress: told how many rounds of how
    many are done. A plan without pushes says that nothing tried is better than what is. Raises
    PlanningError if the goal does not fit the scene, or no push may be tried.
    """
    search = _Search(scene.model_copy(update={"pushes": ()}), goal, dynamics, rng, sampling or Sampling(), risk, reach)
    return search.run(progress)


class _Search:
    def __init__(
        self,
        scene: Scene,
        goal: Goal,
        dynamics: Dynamics,
        rng: np.random.Generator,
        sampling: Sampling,
        risk: Risk,
        reach: Reach | None,
    ) -> None:
        self.scene, self.goal, self.dynamics, self.rng, self.sampling = scene, goal, dynamics, rng, sampling
        self.score = risk(cost_of(scene, goal))
        self.reach = reach
        self.body = index_of(scene, goal.body)
        self.begun = time.perf_counter()
        self.refused: list[str] = []

    def run(self, progress: Callable[[int, int], None]) -> Plan:
        depth, per_push = self.sampling.pushes, self.sampling.rounds + 1
        roots: list[Tried | None] = [None]
        everything: list[Tried] = []
        done = 0
        for _ in range(depth):
            tried: list[Tried] = []
            for k in range(per_push):
                if tried and self._late:
                    break
                tried += self._round(roots, tried, k)
                done += 1
                progress(done, depth * per_push)
            everything += tried
            if not tried:
                break
            roots = list(self._settled(tried)[: self.sampling.branches])
            everything += [root for root in roots if root is not None]
        if not everything:
            reason = f"; {self.refused[0]}" if self.refused else ""
            raise PlanningError(f"goal: no push at or near {self.goal.body!r} may be tried{reason}")
        return self._best(everything)

    def _round(self, roots: Sequence[Tried | None], tried: Sequence[Tried], k: int) -> list[Tried]:
        """Draw pushes that go on from the roots, and try them: anew at first, then around the best."""
        sampling, rng = self.sampling, self.rng
        plans, aims = [], []
        for root in roots:
            poses = self.scene.poses_world_from_body if root is None else root.track.poses[-1, 1:]
            before = () if root is None else root.scene.pushes
            if k == 0:
                count = -(-sampling.candidates // len(roots))
                drawn = first_aims(rng, self.scene, poses, self.body, self.goal.position, count)
            else:
                of_root = [one for one in tried if one.scene.pushes[:-1] == before]
                elites = sorted(of_root, key=lambda one: one.cost)[: sampling.elites]
                if not elites:
                    continue
                best = Aims(*(np.concatenate(column) for column in zip(*(one.aim for one in elites), strict=True)))
                count = -(-sampling.varied // len(roots))
                drawn = best.varied(rng, count, sampling.scale / 2 ** (k - 1), self.scene)
            pushes = aimed_pushes(
                self.scene, poses, drawn, self.body, self.goal.position, sampling.speed, sampling.longest
            )
            for row, push in enumerate(pushes):
                if push is not None:
                    plans.append(self.scene.model_copy(update={"pushes": (*before, push)}))
                    aims.append(drawn.take([row]))
        return self._try(plans, aims)

    def _try(self, plans: Sequence[Scene], aims: Sequence[Aims]) -> list[Tried]:
        """Those that may be tried, with what comes of them."""
        why = refusals(plans, self.reach)
        self.refused += [refusal for refusal in why if refusal is not None]
        left = [k for k, refusal in enumerate(why) if refusal is None]
        tracks = self._tracks([plans[k] for k in left])
        left = left[: len(tracks)]
        if not left:
            return []
        costs = self.score(tracks)
        tried = []
        for k, track, of_track in zip(left, tracks, costs, strict=True):
            begun = _begins(track, plans[k])
            frame = begun + int(of_track[begun : len(track.times)].argmin())
            tried.append(Tried(aims[k], plans[k], track, frame, float(of_track[frame])))
        return tried

    def _tracks(self, plans: Sequence[Scene]) -> list[Track]:
        """What comes of the plans: of all, or of as many as there is time for, but one at least."""
        if not plans:
            return []
        if self.sampling.seconds is None:
            return list(self.dynamics(plans))
        tracks = list(self.dynamics(plans[:1]))
        for plan in plans[1:]:
            if self._late:
                break
            tracks += self.dynamics([plan])
        return tracks

    @property
    def _late(self) -> bool:
        seconds = self.sampling.seconds
        return seconds is not None and time.perf_counter() - self.begun > seconds

    def _settled(self, tried: Sequence[Tried]) -> list[Tried]:
        """The best, ended where they are best, tried again as the tool comes to rest there; best first."""
        moving = [one for one in tried if one.frame > _begins(one.track, one.scene)]
        best = sorted(moving, key=lambda one: one.cost)[: self.sampling.branches]
        ended = [one.scene.model_copy(update={"pushes": self._ended(one)}) for one in best]
        tracks = self._tracks(ended)
        if not tracks:
            return []
        costs = self.score(tracks)
        settled = [
            Tried(one.aim, plan, track, len(track.times) - 1, float(cost[len(track.times) - 1]))
            for one, plan, track, cost in zip(best, ended, tracks, costs, strict=False)
        ]
        return sorted(settled, key=lambda one: one.cost)

    def _ended(self, one: Tried) -> tuple[Push, ...]:
        """The pushes, the last of them no longer than to the frame in which the plan is best."""
        *before, push = one.scene.pushes
        begun = _begins(one.track, one.scene)
        place = ToolMotion(push, self.scene.tool).pose((one.frame - begun) * FRAME)[:2]
        distance = float(np.hypot(*(place - np.array(push.start))))
        return (*before, push.replace(distance=distance))

    def _best(self, everything: Sequence[Tried]) -> Plan:
        """The best of those that were tried to where they end; no push, if none is better than none."""
        stays = starting(everything[0].track)
        plan = Plan(OWN_TOOL, stays.scene, stays, float(self.score([stays])[0, 0]))
        for one in everything:
            if one.frame == len(one.track.times) - 1 and one.cost < plan.cost:
                plan = Plan(OWN_TOOL, one.scene, one.track, one.cost)
        return plan


def _begins(track: Track, plan: Scene) -> int:
    """The frame in which the last push begins; 0 if the track does not come to it."""
    return int(np.argmax(track.push == len(plan.pushes) - 1))


def starting(track: Track) -> Track:
    """The first frame alone, without any push."""
    spread = None if track.spread is None else track.spread.take(slice(1))
    scene = track.scene.model_copy(update={"pushes": ()})
    return Track(scene, track.times[:1], track.poses[:1], np.full(1, LIFTED), track.seen[:1], spread=spread)
