"""What happened in a track: displacement, penetration, what each push moved."""

from itertools import combinations

import numpy as np
import torch
from jaxtyping import Float

from pushgraph.contact import RoundedBox, signed_gap
from pushgraph.pose import relative
from pushgraph.scene import rounded_boxes, take, tool_gaps
from pushgraph.track import Track


def penetration(track: Track) -> Float[np.ndarray, " frames"]:
    """Deepest overlap (m) in each frame, of two bodies that are not one piece or of a body with the tool."""
    scene = track.scene
    together = [set(group) for group in scene.rigid_groups] + [
        {joint.parent, joint.child} for joint in scene.joints if joint.kind == "fixed"
    ]
    pairs = [
        (i, j)
        for i, j in combinations(range(len(scene.bodies)), 2)
        if not any({scene.names[i], scene.names[j]} <= group for group in together)
    ]
    boxes = rounded_boxes([body.shape for body in scene.bodies])
    deepest = np.zeros(len(track.times))
    poses = torch.from_numpy(track.poses[:, 1:])
    if pairs:
        first, second = (torch.tensor(column) for column in zip(*pairs, strict=True))
        reach = boxes.half_extents.norm(dim=-1) + boxes.radius
        distance = (poses[:, first, :2] - poses[:, second, :2]).norm(dim=-1)
        frame, pair = torch.nonzero(distance < (reach[first] + reach[second]), as_tuple=True)
        a, b = first[pair], second[pair]
        gaps = signed_gap(take(boxes, a), take(boxes, b), relative(poses[frame, a], poses[frame, b]))
        np.maximum.at(deepest, frame.numpy(), -gaps.numpy())
    return deepest
