"""Marks of joints: their kind, where they sit, along what they slide and how far they go."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import viser
from jaxtyping import Float

from pushgraph import pose
from pushgraph.body import Joint
from pushgraph.scene import Scene
from pushgraph.view.drawing.colours import JOINTS
from pushgraph.view.drawing.layer import add_lines, add_solid
from pushgraph.view.drawing.solids import circle, prism

RADIUS = 0.009
"""Of a mark (m)."""
ABOVE = 0.004
"""The mark stands out above the higher of the two bodies (m)."""
ARM = 0.045
"""Length of a hinge's hand, which shows how far the child is turned between the limits (m)."""
STEP = np.radians(6)
OUTLINES = {"fixed": circle(1.3 * RADIUS, 4, 0.125), "revolute": circle(RADIUS), "prismatic": circle(1.4 * RADIUS, 4)}
"""Of marks: a square, a round pin, a diamond."""
LINE = 0.003
HAND = (255, 255, 255)


class DrawnJoint(NamedTuple):
    """Lines from above that a joint consists of (m): limits in the parent's frame, hand in the child's."""

    anchor: Float[np.ndarray, "2"]
    limits: list[Float[np.ndarray, "points 2"]]
    hand: Float[np.ndarray, "2 2"]


def add_joint(api: viser.SceneApi, node_of: Callable[[str], str], scene: Scene, joint: Joint, index: int) -> None:
    """The mark and the limits, which the parent carries, and the hand between them, which the child carries."""
    heights = [scene.bodies[scene.names.index(name)].shape.height for name in (joint.parent, joint.child)]
    top, colour = max(heights) + ABOVE, JOINTS[joint.kind]
    drawn = drawn_joint(scene, joint)
    node, hand = f"{node_of(joint.parent)}/joint_{index}", f"{node_of(joint.child)}/joint_{index}_hand"
    mark = prism(OUTLINES[joint.kind] + drawn.anchor, min(heights) / 2, top + ABOVE)
    add_solid(api, node, mark, colour)
    add_lines(api, f"{node}/rim", mark.edges, HAND)
    if joint.kind != "fixed":
        limits = np.concatenate([_level(line, top) for line in drawn.limits])
        api.add_line_segments(f"{node}/limits", limits, colour, thickness=LINE)
        api.add_line_segments(hand, _level(drawn.hand, top + 2 * ABOVE), HAND, thickness=2 * LINE)


def drawn_joint(scene: Scene, joint: Joint) -> DrawnJoint:
    """A hinge's hand points at the child's middle, within its limits; a slider's is a short line on a rail."""
    frame = scene.joint_frame(joint)
    parent, child = (scene.poses_world_from_body[scene.names.index(name)] for name in (joint.parent, joint.child))
    anchor, anchor_in_child = (pose.transform(pose.inverse(body), frame.anchor) for body in (parent, child))
    low, high = frame.limits
    if joint.kind == "revolute":
        towards = child[:2] - frame.anchor
        towards = ARM * towards / max(np.hypot(*towards), 1e-9)
        angles = np.linspace(low, high, max(2, int(np.ceil((high - low) / STEP)) + 1)) - parent[2]
        arc = anchor + pose.rotate(np.broadcast_to(towards, (len(angles), 2)), angles)
        sector = arc if high - low >= 2 * np.pi else np.vstack((anchor, arc, anchor))
        return DrawnJoint(anchor, [sector], anchor_in_child + [np.zeros(2), pose.rotate(towards, -child[2])])
    along, across = pose.rotate(frame.axis, -parent[2]), pose.rotate(frame.axis, np.pi / 2 - parent[2])
    ends = [anchor + far * along for far in (low, high)]
    stops = [np.stack((end - RADIUS * across, end + RADIUS * across)) for end in ends]
    short = 0.6 * RADIUS * pose.rotate(frame.axis, -child[2])
    return DrawnJoint(anchor, [np.stack(ends), *stops], anchor_in_child + [-short, short])


def _level(line: Float[np.ndarray, "points 2"], height: float) -> Float[np.ndarray, "legs 2 3"]:
    points = np.column_stack((line, np.full(len(line), height)))
    return np.stack((points[:-1], points[1:]), 1)
