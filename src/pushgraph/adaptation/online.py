"""The same unknowns while a robot works: each push sharpens what the last one left."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from pushgraph.adaptation.fit import fit
from pushgraph.adaptation.scenes import with_unknowns
from pushgraph.adaptation.unknowns import Estimate
from pushgraph.errors import AdaptationError
from pushgraph.network.contract import Dynamics
from pushgraph.real_pushes import RealPushes
from pushgraph.scene import Scene
from pushgraph.shape import Cylinder
from pushgraph.tool import Push, Tool

PoseLike = Sequence[float] | Float[np.ndarray, "3"]


class PushLearner:
    """Physical unknowns of the bodies of a scene, by name, from pushes of one body at a time.

    estimates: of bodies that were pushed. A Gaussian at all times: the posterior of one push is the prior of the next.
    """

    def __init__(self, dynamics: Dynamics) -> None:
        self.dynamics = dynamics
        self.estimates: dict[str, Estimate] = {}

    def observe(self, scene: Scene, body: str, start: PoseLike, end: PoseLike, probe: Push) -> Estimate:
        """Learn from a push that moved one body alone. start, end: pose_world_from_body before and after.

        Raises AdaptationError if the tool is not round, the push not straight, or a pose not finite.
        """
        before, after = (np.array(values, dtype=float) for values in (start, end))
        if before.shape != (3,) or after.shape != (3,) or not np.isfinite([before, after]).all():
            raise AdaptationError(f"{body!r}: start and end must be finite poses (x, y, yaw), got {start} and {end}")
        waypoints = probe.waypoints
        if len(waypoints) != 2:
            raise AdaptationError(
                f"{body!r}: only from straight pushes can be learnt, this one has {len(waypoints) - 1}"
            )
        shape = scene.bodies[scene.names.index(body)].shape
        push = RealPushes(
            shapes={body: shape},
            surface=np.array([""]),
            shape=np.array([body]),
            speed=np.array([probe.speed]),
            before=before[None],
            after=after[None],
            probe_start=waypoints[:1, :2],
            probe_end=waypoints[1:, :2],
            stated={},
            probe_radius=tool_radius(scene.tool),
        )
        known = self.estimates.get(body, Estimate.prior())
        self.estimates[body] = fit(self.dynamics, push, known)
        return self.estimates[body]

    def apply_to(self, scene: Scene) -> Scene:
        """The scene with what was learnt: side friction (the surest body counts most), and where bodies press."""
        return with_unknowns(scene, self.estimates)


def tool_radius(tool: Tool) -> float:
    """Of a round tool (m); raises AdaptationError if it is none."""
    part = tool.parts[0]
    if len(tool.parts) > 1 or not isinstance(part.shape, Cylinder) or any(part.pose_tool_from_part[:2]):
        raise AdaptationError("the tool: unknowns are learnt from pushes of a round tool alone, one cylinder")
    return part.shape.diameter / 2
