"""Hundreds of malformed scene files: each gets one of our errors, none a traceback."""

import json
import random
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from scenes import workshop

from pushgraph.cli import main

NOT_A_NUMBER = ("0.1", None, True, [], {}, [0.1], float("nan"), float("inf"), -float("inf"), 1e400)
NOT_A_SIZE = (*NOT_A_NUMBER, -0.1, 0, 1e-9, 1e9)
Mutation = Callable[[dict, random.Random], object]


def set_size(scene: dict, rng: random.Random) -> None:
    shape = rng.choice([*scene["bodies"], *scene["tool"]["parts"]])["shape"]
    if shape["kind"] == "cylinder":
        shape["diameter"] = rng.choice(NOT_A_SIZE)
    elif rng.random() < 0.5:
        shape["size"][rng.randrange(2)] = rng.choice(NOT_A_SIZE)
    else:
        shape["size"] = rng.choice([None, [], [0.1], [0.1, 0.1, 0.1], 0.1, "big"])


def set_height(scene: dict, rng: random.Random) -> None:
    rng.choice(scene["bodies"])["shape"]["height"] = rng.choice(NOT_A_SIZE)


def set_mass(scene: dict, rng: random.Random) -> None:
    rng.choice(scene["bodies"])["mass"] = rng.choice([bad for bad in NOT_A_SIZE if bad not in (None, 1e-9)])


def set_pose(scene: dict, rng: random.Random) -> None:
    pose = rng.choice(scene["bodies"])["pose_world_from_body"]
    if rng.random() < 0.7:
        pose[rng.randrange(3)] = rng.choice((*NOT_A_NUMBER, 1e9))
    else:
        pose.append(0.0) if rng.random() < 0.5 else pose.pop()


def overlap(scene: dict, rng: random.Random) -> None:
    one, other = rng.sample(scene["bodies"][:3], 2)
    one["pose_world_from_body"] = other["pose_world_from_body"]


def duplicate(scene: dict, rng: random.Random) -> None:
    one, other = rng.sample(scene["bodies"], 2)
    one["name"] = other["name"]


def rename(scene: dict, rng: random.Random) -> None:
    rng.choice(scene["bodies"])["name"] = rng.choice(["robot", "", " ", 3, None, "a\nb", "x" * 65, ["a"]])


def break_joint(scene: dict, rng: random.Random) -> None:
    joint = scene["joints"][0]
    field, value = rng.choice(
        [
            ("parent", "nobody"), ("child", "nobody"), ("child", "plate"), ("parent", 1), ("kind", "ball"),
            ("kind", None), ("axis", [1, 0]),
            ("limits", [0.1, 0.2]), ("limits", [-1]), ("limits", [None, 1]), ("anchor", [0]),
            ("anchor", ["a", "b"]), ("limits", "wide"),
        ]
    )  # fmt: skip
    joint[field] = value


def join_twice(scene: dict, rng: random.Random) -> None:
    kind = rng.choice(["fixed", "revolute", "prismatic"])
    joined = rng.choice([("plate", "lid"), ("lid", "plate"), ("cup", "handle"), ("cup", "cup")])
    scene["joints"].append({"kind": kind, "parent": joined[0], "child": joined[1]})


def break_group(scene: dict, rng: random.Random) -> None:
    scene["rigid_groups"] = rng.choice(
        [[["cup"]], [["cup", "nobody"]], [["cup", "cup"]], [[]], "cup", [None], {"a": 1}]
    )


def break_push(scene: dict, rng: random.Random) -> None:
    push = rng.choice(scene["pushes"])
    field, value = rng.choice(
        [
            ("start", None),
            ("start", [0]),
            ("speed", 0),
            ("speed", -1),
            ("speed", "fast"),
            ("rotation", 100),
            ("yaw", "left"),
        ]
        + [("distance", -1), ("distance", None), ("end", [50, 50]), ("end", [0, "a"]), ("speed", 1e300)]
    )
    if field in ("distance", "end"):
        push.pop("direction", None), push.pop("end", None), push.pop("distance", None)
    push[field] = value


def break_fixed(scene: dict, rng: random.Random) -> None:
    """No truth value, or the joint of two bodies of which none can move."""
    if rng.random() < 0.7:
        rng.choice(scene["bodies"])["fixed"] = rng.choice(["yes", "true", 1, 0, None, [], 0.5])
    else:
        scene["bodies"][0]["fixed"] = scene["bodies"][1]["fixed"] = True


def break_path(scene: dict, rng: random.Random) -> None:
    """Of a push along a path: one of its way-points or times, or what does not go with them."""
    push = scene["pushes"][1]
    del push["direction"], push["distance"]
    push |= {"path": [[0.25, -0.3], [0.3, -0.3, 0.5], [0.3, -0.2]], "times": [1, 1.5, 2]}
    field = rng.choice(["path", "path", "times", "times", "rest", "force_limit", "other"])
    if field == "path":
        push["path"][rng.randrange(3)] = rng.choice([None, 3, [], [0.1], [0.1] * 4, [0.1, "a"], [0.1, 1e3], [1e400, 0]])
    elif field == "times":
        push["times"][rng.randrange(3)] = rng.choice([None, "1", -1, 0, 0.001, 1.499999, 1e9, True, [1]])
    elif field in ("rest", "force_limit"):
        push[field] = rng.choice([-1, "1", 1e400, [], 1e9])
    else:
        push |= rng.choice([{"end": [0, 0]}, {"rotation": 1.0}, {"path": {}}, {"path": []}, {"times": []}])


def push_from_inside_a_body(scene: dict, rng: random.Random) -> None:
    scene["pushes"][0]["start"] = rng.choice(scene["bodies"])["pose_world_from_body"][:2]


def break_tool(scene: dict, rng: random.Random) -> None:
    scene["tool"] = rng.choice(
        [None, {}, {"parts": []}, {"parts": [{}]}, {"parts": None}, [], {"parts": [3]}, "finger"]
    )


def break_table(scene: dict, rng: random.Random) -> None:
    field, value = rng.choice(
        [("size", [0, 1]), ("size", [0.2, 0.2]), ("size", 2), ("friction", 0), ("friction", -1), ("friction", "ice")]
    )
    scene["table"][field] = value


def drop_a_field(scene: dict, rng: random.Random) -> None:
    record, fields = rng.choice(
        [
            (scene, ["format", "version", "bodies"]),
            (rng.choice(scene["bodies"]), ["name", "shape", "pose_world_from_body"]),
            (rng.choice(scene["bodies"])["shape"], ["kind"]),
            (scene["joints"][0], ["kind", "parent", "child"]),
            (rng.choice(scene["pushes"]), ["start"]),
        ]
    )
    del record[rng.choice(fields)]


def add_a_field(scene: dict, rng: random.Random) -> None:
    record = rng.choice(
        [scene, scene["bodies"][0], scene["bodies"][0]["shape"], scene["joints"][0], scene["pushes"][0]]
    )
    record[rng.choice(["colour", "Mass", "masse", "", "diameters"])] = 1


def change_the_version(scene: dict, rng: random.Random) -> None:
    scene[rng.choice(["version", "format"])] = rng.choice([2, 99, 0, -1, "1", None, 1.5, [1], "pushgraph.scenes"])


def truncate(scene: dict, rng: random.Random) -> str:
    text = json.dumps(scene)
    return text[: rng.randrange(len(text))]


def garble(scene: dict, rng: random.Random) -> str:
    text = json.dumps(scene)
    place = rng.choice([k for k, letter in enumerate(text) if letter in "[]{}:,"])
    return text[:place] + rng.choice(["", "@", "]]", "{", "\x00"]) + text[place + 1 :]


def replace_the_whole(scene: dict, rng: random.Random) -> str:
    return rng.choice(["", "null", "[]", "1", '"scene"', "[" * 50_000, "{" * 9, "\ufeff{}", "NaN", json.dumps([scene])])


MUTATIONS: list[Mutation] = [
    set_size, set_height, set_mass, set_pose, overlap, duplicate, rename, break_joint, join_twice, break_group,
    break_push, break_path, break_fixed, push_from_inside_a_body, break_tool, break_table, drop_a_field,
    add_a_field, change_the_version, truncate, garble, replace_the_whole,
]  # fmt: skip


def malformed(seed: int) -> str:
    rng = random.Random(seed)
    scene = json.loads(workshop().to_json())
    text = MUTATIONS[seed % len(MUTATIONS)](scene, rng)
    return text if isinstance(text, str) else json.dumps(scene)


def test_the_scene_that_is_mutated_is_valid(tmp_path: Path) -> None:
    path = tmp_path / "scene.json"
    path.write_text(json.dumps(json.loads(workshop().to_json())))
    with pytest.raises(SystemExit) as exit_:
        main(["simulate", str(path), "--out", str(tmp_path / "out"), "--animation", "none"])
    assert exit_.value.code == 0


@pytest.mark.parametrize("seed", range(242))
def test_a_malformed_scene_gets_our_error_and_a_non_zero_exit(seed: int, tmp_path: Path, capsys) -> None:
    path = tmp_path / "scene.json"
    path.write_text(malformed(seed))
    with pytest.raises(SystemExit) as exit_:
        main(["simulate", str(path), "--out", str(tmp_path / "out"), "--animation", "none"])
    assert exit_.value.code == 1
    assert capsys.readouterr().err.startswith("Error: ")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("seed", [0, 17, 18])
def test_the_installed_command_shows_no_traceback(seed: int, tmp_path: Path) -> None:
    path = tmp_path / "scene.json"
    path.write_text(malformed(seed))
    command = [Path(sys.executable).with_name("pushgraph"), "simulate", path, "--out", tmp_path / "out"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 1
    assert done.stderr.startswith("Error: ")
    assert "Traceback" not in done.stderr + done.stdout
