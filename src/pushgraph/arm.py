"""The arm that holds the tool: where it stands, and which joint angles bring the tool where, in closed form."""

import math
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Bool, Float
from pydantic import Field

from pushgraph import pose
from pushgraph.record import Record
from pushgraph.shape import Pose

SHOULDER_HEIGHT, UPPER_ARM, FOREARM = 0.1273, 0.612, 0.5723
"""Of the UR10 (m): its shoulder above its base, and its two long links."""
SIDE, WRIST, FLANGE = 0.163941, 0.1157, 0.0922
"""Of the UR10 (m): the wrist stands beside the plane of the long links; wrist 2 and wrist 3 lie so far from the joint
before them."""
NEAREST = 0.33
"""The flange stays so far from the axis of the base (m): nearer, forearm and wrist would touch base or upper arm."""
Metres = Annotated[float, Field(ge=-2, le=2)]


class Arm(Record):
    """A UR10 from whose flange the tool hangs, its axis straight down. What carries the base is not modelled."""

    kind: Literal["ur10"] = "ur10"
    pose_world_from_base: Pose = (0.53, -0.53, 0.75 * math.pi)
    """Where its base stands; along its x the arm points at angle 0 of its first joint."""
    base_height: Metres = 0.3
    """Of the base above the table (m)."""
    flange_height: Annotated[float, Field(ge=0.15, le=1)] = 0.3
    """Of the flange above the table while the tool pushes (m)."""
    lift: Annotated[float, Field(ge=0.02, le=0.5)] = 0.15
    """How high the tool is lifted between pushes (m)."""

    def joint_angles(
        self, poses_world_from_tool: Float[np.ndarray, "*batch 3"], lift: Float[np.ndarray, "*#batch"] | float = 0.0
    ) -> Float[np.ndarray, "*batch 6"]:
        """Angles (rad) that bring the tool to each pose, lifted by so much (m); NaN where it is out of reach.

        Of the eight solutions the one with the elbow up, the wrist outside and the links beside the line to the
        flange at its right. The first joint is as the flange is within half a turn of where the base faces; a whole
        turn of the tool is one of the last joint.
        """
        in_base = pose.relative(np.array(self.pose_world_from_base), poses_world_from_tool)
        distance = np.hypot(in_base[..., 0], in_base[..., 1])
        height = self.flange_height + lift + FLANGE - self.base_height - SHOULDER_HEIGHT
        with np.errstate(invalid="ignore"):
            outward = np.sqrt(distance**2 - SIDE**2)
            across = np.hypot(outward - WRIST, height)
            shoulder = np.arccos((UPPER_ARM**2 + across**2 - FOREARM**2) / (2 * UPPER_ARM * across))
            elbow = math.pi - np.arccos((UPPER_ARM**2 + FOREARM**2 - across**2) / (2 * UPPER_ARM * FOREARM))
        first = np.arctan2(in_base[..., 1], in_base[..., 0]) - np.arctan2(SIDE, outward)
        second = -(np.arctan2(height, outward - WRIST) + shoulder)
        last = first - math.pi / 2 - in_base[..., 2]
        right_angle = np.full_like(first, -math.pi / 2)
        return np.stack((first, second, elbow, -math.pi / 2 - second - elbow, right_angle, last), -1)

    def distances(self, poses_world_from_tool: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch"]:
        """Of the flange from the axis of the base (m)."""
        return np.linalg.norm(poses_world_from_tool[..., :2] - np.array(self.pose_world_from_base[:2]), axis=-1)

    @property
    def farthest(self) -> float:
        """How far from the axis of the base the flange reaches, both down and lifted (m)."""
        low = self.flange_height + FLANGE - self.base_height - SHOULDER_HEIGHT
        height = max(abs(low), abs(low + self.lift))
        straight = math.sqrt(max(0.0, (UPPER_ARM + FOREARM) ** 2 - height**2))
        return math.hypot(straight + WRIST, SIDE)

    def reaches(self, poses_world_from_tool: Float[np.ndarray, "*batch 3"]) -> Bool[np.ndarray, "*batch"]:
        """Whether the arm brings the tool to each pose, down and lifted.

        Speeds, turns of the last joint and what the arm may touch are not asked.
        """
        angles = np.stack([self.joint_angles(poses_world_from_tool, lift) for lift in (0.0, self.lift)])
        return np.isfinite(angles).all((0, -1)) & (self.distances(poses_world_from_tool) >= NEAREST)

    def moved(self, pose_new_from_world: Float[np.ndarray, "3"]) -> "Arm":
        """Return the same arm, seen from another world frame."""
        place = pose.compose(pose_new_from_world, np.array(self.pose_world_from_base))
        return self.replace(pose_world_from_base=tuple(place.tolist()))
