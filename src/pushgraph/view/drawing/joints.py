"""Marks of joints: their kind, where they sit, along what they slide and how far they go."""

from collections.abc import Callable

import numpy as np
import viser
from jaxtyping import Float

from pushgraph import pose
from pushgraph.body import Joint
from pushgraph.scene import Scene
from pushgraph.view.drawing.colours import JOINTS
from pushgraph.view.drawing.solids import circle, prism

RADIUS = 0.009
"""Of a mark (m)."""
ABOVE = 0.004
"""The mark stands out above the higher of the two bodies (m)."""
ARM = 0.045
"""Length of a hinge's hand, which shows how far the child is turned between the limits (m)."""
STEP = np.radians(6)
LINE = 0.003


def add_joint(api: viser.SceneApi, node_of: Callable[[str], str], scene: Scene, joint: Joint, index: int) -> None:
    """The mark and the limits, which the parent carries; a hand or a slide, which the child carries, moves in them."""
    frame = scene.joint_frame(joint)
    parent, child = scene.names.index(joint.parent), scene.names.index(joint.child)
    poses = scene.poses_world_from_body
    heights = [scene.bodies[end].shape.height for end in (parent, child)]
    top = max(heights) + ABOVE
    colour = JOINTS[joint.kind]
    in_parent, in_child = (pose.transform(pose.inverse(poses[end]), frame.anchor) for end in (parent, child))
    node = f"{node_of(joint.parent)}/joint_{index}"
    outline = circle(RADIUS) if joint.kind == "revolute" else circle(RADIUS, 4) @ _turned(np.pi / 4)
    if joint.kind == "prismatic":
        outline = circle(1.3 * RADIUS, 4)
    solid = prism(outline + in_parent, min(heights) * 0.5, top + ABOVE)
    api.add_mesh_simple(node, solid.vertices, solid.faces, color=colour, flat_shading=True, side="double")
    api.add_line_segments(f"{node}/rim", solid.edges, (255, 255, 255), thickness=1.2, thickness_units="screen")
    if joint.kind == "fixed":
        return
    hand = f"{node_of(joint.child)}/joint_{index}_moves"
    low, high = frame.limits
    if joint.kind == "revolute":
        towards = poses[child, :2] - frame.anchor
        towards = towards / max(np.hypot(*towards), 1e-9)
        from_anchor = pose.rotate(towards, -poses[parent, 2])
        angles = np.linspace(low, high, max(2, int(np.ceil((high - low) / STEP)) + 1))
        arc = in_parent + ARM * np.stack([pose.rotate(from_anchor, angle) for angle in angles])
        lines = [arc] if high - low >= 2 * np.pi else [np.vstack((in_parent, arc, in_parent))]
        tip = in_child + ARM * pose.rotate(towards, -poses[child, 2])
        _add_lines(api, hand, [np.vstack((in_child, tip))], top + ABOVE, (255, 255, 255), 1.6 * LINE)
    else:
        axis = pose.rotate(frame.axis, -poses[parent, 2])
        across = RADIUS * pose.rotate(axis, np.pi / 2)
        ends = [in_parent + far * axis for far in (low, high)]
        lines = [np.vstack(ends), *(np.vstack((end - across, end + across)) for end in ends)]
        _add_lines(
            api,
            hand,
            [
                np.vstack(
                    [in_child + side * 0.6 * RADIUS * pose.rotate(frame.axis, -poses[child, 2]) for side in (-1, 1)]
                )
            ],
            top + 2 * ABOVE,
            (255, 255, 255),
            3 * LINE,
        )
    _add_lines(api, f"{node}/limits", lines, top, colour, LINE)


def _add_lines(
    api: viser.SceneApi,
    node: str,
    lines: list[Float[np.ndarray, "points 2"]],
    height: float,
    colour: tuple[int, int, int],
    thickness: float,
) -> None:
    points = np.concatenate([np.stack((line[:-1], line[1:]), 1) for line in lines])
    flat = np.concatenate((points, np.full((*points.shape[:2], 1), height)), -1)
    api.add_line_segments(node, flat, colour, thickness=thickness)


def _turned(angle: float) -> Float[np.ndarray, "2 2"]:
    return np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
