"""Scenes whose bodies stand elsewhere than they were written."""

import numpy as np
from jaxtyping import Float

from pushgraph import pose
from pushgraph.body import Joint
from pushgraph.scene import Scene


def scene_at(scene: Scene, poses_world_from_body: Float[np.ndarray, "bodies 3"]) -> Scene:
    """The scene with its bodies at these poses; joints keep their place in their parent.

    Raises SceneError if bodies overlap there, or a push comes down on one.
    """
    old, new = scene.poses_world_from_body, poses_world_from_body

    def carried(joint: Joint) -> Joint:
        parent = scene.names.index(joint.parent)
        frame = scene.joint_frame(joint)
        anchor = pose.transform(new[parent], pose.transform(pose.inverse(old[parent]), frame.anchor))
        axis = pose.rotate(frame.axis, new[parent, 2] - old[parent, 2])
        return joint.replace(
            anchor=tuple(anchor.tolist()),
            axis=tuple(axis.tolist()) if joint.kind == "prismatic" else None,
            limits=frame.limits if joint.kind != "fixed" else None,
        )

    bodies = tuple(
        body.replace(pose_world_from_body=tuple(place)) for body, place in zip(scene.bodies, new.tolist(), strict=True)
    )
    return scene.replace(bodies=bodies, joints=tuple(carried(joint) for joint in scene.joints))
