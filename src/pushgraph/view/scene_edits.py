"""Edits of a scene: each gives a new scene, read as a scene file would be, so that it is refused in the same words."""

import json
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from pushgraph import pose
from pushgraph.errors import SceneError
from pushgraph.scene import Scene

Content = dict[str, Any]
"""A scene as it stands in its file."""
NEW_PUSH = 0.15
"""How far a new push goes (m)."""


def edited(scene: Scene, change: Callable[[Content], None]) -> Scene:
    """The scene with its content changed; raises SceneError if that is no valid scene."""
    content = json.loads(scene.to_json(None))
    change(content)
    return Scene.from_json(json.dumps(content), "scene")


def add_body(scene: Scene, body: Content) -> Scene:
    """With one more body, as it stands in a scene file."""
    return edited(scene, lambda content: content["bodies"].append(body))


def change_body(scene: Scene, name: str, fields: Content, place: Sequence[float] | None = None) -> Scene:
    """With other fields of a body: name, shape, mass, fixed; joints and groups keep to it if it is renamed.

    place: as in `place_body`; at once, for the one may need the other.
    """
    index = _index(scene, name)
    moved = None if place is None else _moved(scene, name, place)

    def change(content: Content) -> None:
        if moved is not None:
            moved(content)
        content["bodies"][index] |= fields
        new = fields.get("name", name)
        for joint in content["joints"]:
            joint |= {end: new for end in ("parent", "child") if joint[end] == name}
        for field in ("rigid_groups", "unknown_pairs"):
            if not isinstance(content[field], str):
                content[field] = [[new if one == name else one for one in names] for names in content[field]]

    return edited(scene, change)


def place_body(scene: Scene, name: str, place: Sequence[float]) -> Scene:
    """With a body at another pose (x, y, yaw); all of its rigid group, and the joints that it is the parent of, too."""
    return edited(scene, _moved(scene, name, place))


def _moved(scene: Scene, name: str, place: Sequence[float]) -> Callable[[Content], None]:
    index = _index(scene, name)
    new = np.array(place, dtype=float)
    old = scene.poses_world_from_body[index]
    if not np.isfinite(new).all():
        raise SceneError(f"scene: bodies[{index}] {name!r}: pose_world_from_body: must be finite, got {list(place)}")
    motion = pose.compose(new, pose.inverse(old))
    piece = {name}.union(*(group for group in scene.rigid_groups if name in group))

    def change(content: Content) -> None:
        for body in content["bodies"]:
            if body["name"] in piece:
                x, y, _ = pose.compose(motion, np.array(body["pose_world_from_body"], dtype=float)).tolist()
                body["pose_world_from_body"] = [x, y, body["pose_world_from_body"][2] + float(new[2] - old[2])]
        content["bodies"][index]["pose_world_from_body"] = new.tolist()
        for joint in content["joints"]:
            if joint["parent"] in piece:
                if joint.get("anchor") is not None:
                    joint["anchor"] = pose.transform(motion, np.array(joint["anchor"], dtype=float)).tolist()
                if joint.get("axis") is not None:
                    joint["axis"] = pose.rotate(np.array(joint["axis"], dtype=float), motion[2]).tolist()

    return change


def delete_body(scene: Scene, name: str) -> Scene:
    """Without a body, its joints, and its places in rigid groups and unknown pairs."""
    index = _index(scene, name)

    def change(content: Content) -> None:
        del content["bodies"][index]
        content["joints"] = [joint for joint in content["joints"] if name not in (joint["parent"], joint["child"])]
        groups = [[one for one in group if one != name] for group in content["rigid_groups"]]
        content["rigid_groups"] = [group for group in groups if len(group) > 1]
        if not isinstance(content["unknown_pairs"], str):
            content["unknown_pairs"] = [pair for pair in content["unknown_pairs"] if name not in pair]

    return edited(scene, change)


def join(scene: Scene, joint: Content) -> Scene:
    """With one more joint, as it stands in a scene file; that pair is not unknown any more."""

    def change(content: Content) -> None:
        content["joints"].append(joint)
        if not isinstance(content["unknown_pairs"], str):
            pair = {joint.get("parent"), joint.get("child")}
            content["unknown_pairs"] = [one for one in content["unknown_pairs"] if set(one) != pair]

    return edited(scene, change)


def part(scene: Scene, one: str, other: str) -> Scene:
    """Without the joint of two bodies."""
    left = [joint for joint in scene.joints if {joint.parent, joint.child} != {one, other}]
    if len(left) == len(scene.joints):
        raise SceneError(f"scene: joints: {one!r} and {other!r} are not joined")
    return scene.replace(joints=tuple(left))


def move_push_end(scene: Scene, push: int, end: str, point: Sequence[float]) -> Scene:
    """With the "start" or the "end" of a push (by index) elsewhere; of a path, its last way-point."""
    _check_push(scene, push)
    if end not in ("start", "end"):
        raise SceneError(f"scene: pushes[{push}]: no {end!r}; valid: start, end")
    place = [float(value) for value in point]

    def change(content: Content) -> None:
        of_push = content["pushes"][push]
        if end == "start" and of_push.get("direction") is not None:
            of_push["end"] = scene.pushes[push].waypoints[-1, :2].tolist()
        if end == "start":
            of_push["start"] = place
        elif of_push.get("path") is not None:
            of_push["path"][-1] = [*place, *of_push["path"][-1][2:]]
        else:
            of_push["end"] = place
        if of_push.get("end") is not None:
            of_push.pop("direction", None)
            of_push.pop("distance", None)

    return edited(scene, change)


def add_push(scene: Scene, push: Content | None = None) -> Scene:
    """With one more push, as it stands in a scene file; by default one towards the first body that can move."""
    made = push or _new_push(scene)
    return edited(scene, lambda content: content["pushes"].append(made))


def change_push(scene: Scene, push: int, fields: Content) -> Scene:
    """With other fields of a push (by index), such as its speed."""
    _check_push(scene, push)
    return edited(scene, lambda content: content["pushes"][push].update(fields))


def delete_push(scene: Scene, push: int) -> Scene:
    """Without a push (by index)."""
    _check_push(scene, push)

    def change(content: Content) -> None:
        del content["pushes"][push]

    return edited(scene, change)


def _index(scene: Scene, name: str) -> int:
    if name not in scene.names:
        raise SceneError(f"scene: bodies: no body {name!r}; valid: {', '.join(scene.names)}")
    return scene.names.index(name)


def _check_push(scene: Scene, push: int) -> None:
    if not 0 <= push < len(scene.pushes):
        valid = f"valid: 0 to {len(scene.pushes) - 1}" if scene.pushes else "the scene has none"
        raise SceneError(f"scene: pushes: no push {push}; {valid}")


def _new_push(scene: Scene) -> Content:
    """Of the directions around the first body that can move, the one from where the tool has most room."""
    body = int(np.argmin(scene.immovable))
    centre = pose.transform(scene.poses_world_from_body[body], np.array(scene.bodies[body].shape.centroid))
    away = scene.bodies[body].shape.reach + scene.tool.reach + 0.03
    angles = np.arange(16) * (2 * np.pi / 16)
    ways = np.stack((np.cos(angles), np.sin(angles)), -1)
    starts = centre - away * ways
    tools = np.concatenate((starts, np.zeros((len(starts), 1))), -1)
    gaps = scene.tool_gaps(tools, np.repeat(scene.poses_world_from_body[None], len(tools), 0)).min(-1)
    best = int(np.argmax(np.minimum(gaps, 0.02)))
    end = starts[best] + NEW_PUSH * ways[best]
    return {"start": np.round(starts[best], 4).tolist(), "end": np.round(end, 4).tolist()}
