"""Whether the arm that holds the tool can make a push."""

import numpy as np

from pushgraph.arm import Arm
from pushgraph.scene import Scene
from pushgraph.simulation.motion import plan_tool
from pushgraph.tool import Push


def arm_reach(scene: Scene, push: Push) -> str | None:
    """Say where a push leaves the reach of the scene's arm, or of one at the default place; None if it does not.

    For planners, see `pushgraph.planning.admissible.Reach`. Joint speeds and what the arm itself would touch are
    checked before it moves, by `pushgraph.simulation.arm`.
    """
    poses, _ = plan_tool((push,), scene.tool)
    reached = (scene.arm or Arm()).reaches(poses)
    if reached.all():
        return None
    x, y, _ = poses[int(np.argmin(reached))]
    return f"({x:.3g}, {y:.3g}) is out of the arm's reach"
