"""Readers of recordings: each format, as its own programs write it, gives the same sightings."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from pushgraph.errors import TrackError
from pushgraph.recording.convention import Convention
from pushgraph.recording.files import read_sightings, save_sightings
from pushgraph.recording.sightings import NO_PUSH, ReadOptions, Sightings, planar

TIMES = np.array([0.0, 0.1, 0.2])
YAWS = 0.5 + TIMES


def check(sightings: Sightings, names: tuple[str, ...] = ("robot", "cup"), start: float = 0.0) -> None:
    """Robot at (t, 0) without turn, cup at (0.3, 0.2) turned by YAWS, in the world frame."""
    world = Convention.of(sightings.declared).apply(sightings)
    assert world.names == names
    for node, x, y, yaw in ((0, TIMES, 0 * TIMES, 0 * TIMES), (1, 0 * TIMES + 0.3, 0 * TIMES + 0.2, YAWS)):
        rows = world.node == node
        np.testing.assert_allclose(world.time[rows] - start, TIMES, atol=1e-6)
        np.testing.assert_allclose(world.x[rows], x, atol=1e-6)
        np.testing.assert_allclose(world.y[rows], y, atol=1e-6)
        np.testing.assert_allclose(world.yaw[rows], yaw, atol=1e-6)


def written(path: Path, lines: list[str], encoding: str = "utf-8") -> Path:
    path.write_text("\n".join(lines) + "\n", encoding=encoding)
    return path


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
def test_long_csv_in_units_of_its_header(tmp_path: Path, encoding: str) -> None:
    lines = ["timestamp (ms);name;x [mm];y [mm];theta_deg;push"]
    for time, yaw in zip(TIMES, YAWS, strict=True):
        lines.append(f"{time * 1e3};robot;{str(time * 1e3).replace('.', ',')};0;0;0")
        lines.append(f"{time * 1e3};Schüssel;300;200;{math.degrees(yaw)};")
    sightings = read_sightings(written(tmp_path / "long.csv", lines, encoding))
    check(sightings, ("robot", "Schüssel"))
    assert sightings.push.tolist() == [0, NO_PUSH] * 3


def test_wide_csv_with_comments_axes_and_quaternions(tmp_path: Path) -> None:
    lines = ["# units: cm", "# axes: x,-y", "# made by hand"]
    lines.append("t,robot_x,robot_y,robot_yaw,cup.x,cup.y,cup.qx,cup.qy,cup.qz,cup.qw")
    for time, yaw in zip(TIMES, YAWS, strict=True):
        lines.append(f"{time},{time * 100},0,0,30,-20,0,0,{-math.sin(yaw / 2)},{math.cos(yaw / 2)}")
    check(read_sightings(written(tmp_path / "wide.csv", lines)))


def test_numbers_that_stand_for_lost_tags_and_dates_for_times(tmp_path: Path) -> None:
    lines = ["time,node,x,y,yaw"]
    for second, x in enumerate(("0.1", "", "nan", "None", "inf")):
        lines.append(f"2024-05-01T12:00:0{second}+00:00,cup,{x},0.2,0.3")
    sightings = read_sightings(written(tmp_path / "lost.csv", lines))
    assert sightings.seen.tolist() == [True, False, False, False, False]
    np.testing.assert_allclose(np.diff(sightings.time), 1.0)


@pytest.mark.parametrize(
    ("lines", "says"),
    [
        (["time,node,x,y,yaw", "0,cup,here,0,0"], "line 2: x: must be a number, got 'here'"),
        (["# units: furlong", "time,node,x,y"], "line 1: no unit 'furlong'; valid: m, cm, mm"),
        (["time,node,x (mm),y (m)", "0,cup,1,2"], "length is declared twice, as mm and m"),
        (["a,b,c", "1,2,3"], "line 1: no column 'time'"),
        (["time,a,b", "1,2,3"], "the header needs time, node, x, y and yaw"),
        (["time,node,x,y,yaw"], "holds no poses"),
        (["time,node,x,y,yaw,push", "0,robot,0,0,0,1.5"], "push: must be a whole number"),
        (["time,node,x,y", "soon,cup,1,2"], "line 2: time: must be a number, got 'soon'"),
        ([""], "no column 'time'"),
    ],
)
def test_a_faulty_csv_is_refused_by_line(tmp_path: Path, lines: list[str], says: str) -> None:
    with pytest.raises(TrackError, match=says) as error:
        Convention.of(read_sightings(written(tmp_path / "faulty.csv", lines)).declared)
    assert "faulty.csv" in str(error.value)


def test_spatial_poses_on_a_table_whichever_axis_is_up() -> None:
    yaw = 0.7
    about = [0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)]
    for up, position, quaternion in (
        ("z", (1.0, 2.0, 3.0), about),
        ("y", (1.0, 3.0, -2.0), [about[0], about[2], -about[1], about[3]]),
        ("x", (3.0, 1.0, 2.0), [about[2], about[0], about[1], about[3]]),
    ):
        np.testing.assert_allclose(planar(position, quaternion, up), (1, 2, yaw, 3, 0), atol=1e-7)
    lying = planar([0.0] * 3, [math.sin(0.5), 0.0, 0.0, math.cos(0.5)], "z")
    assert lying.tilt == pytest.approx(1.0)
    assert math.isnan(planar([0.0] * 3, [0.0] * 4, "z").yaw)


def motive(path: Path) -> Path:
    lines = [
        "Format Version,1.23,Take Name,Take,Length Units,Millimeters,Rotation Type,Quaternion",
        "",
        ",Type" + ",Rigid Body" * 14 + ",Marker",
        ",Name" + ",robot" * 7 + ",cup" * 7 + ",cup:Marker1",
        ",ID" + ",1" * 7 + ",2" * 7 + ",3",
        "," + ",Rotation,Rotation,Rotation,Rotation,Position,Position,Position" * 2 + ",Position",
        "Frame,Time (Seconds)" + ",X,Y,Z,W,X,Y,Z" * 2 + ",X",
    ]
    for frame, (time, yaw) in enumerate(zip(TIMES, YAWS, strict=True)):
        cup = f"0,{math.sin(yaw / 2)},0,{math.cos(yaw / 2)},300,50,-200"
        lines.append(f"{frame},{time},0,0,0,1,{time * 1e3},50,0,{cup},7")
    return written(path, lines)


def test_motive_exports_have_y_up(tmp_path: Path) -> None:
    sightings = read_sightings(motive(tmp_path / "take.csv"))
    check(sightings)
    assert np.allclose(sightings.tilt, 0, atol=1e-6)
    assert "y is taken as up" in sightings.remarks[0]
    path = tmp_path / "markers.csv"
    path.write_text(motive(tmp_path / "take.csv").read_text().replace("Rigid Body", "Marker"))
    with pytest.raises(TrackError, match="export rigid bodies"):
        read_sightings(path)


def quaternion(yaw: float) -> tuple[float, float, float, float]:
    return 0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)


def write_bag(path: Path, kind: str) -> Path:
    """The robot as a stamped pose, the cup as a transform, the push as a number, all of epoch times."""
    pytest.importorskip("rosbags")
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if kind == "bag" else Stores.ROS2_HUMBLE)
    types = store.types
    writer = Writer1(path) if kind == "bag" else Writer2(path, version=9, storage_plugin=StoragePlugin[kind])

    def header(stamp: float):
        time = types["builtin_interfaces/msg/Time"](sec=1_700_000_000 + int(stamp), nanosec=round(stamp % 1 * 1e9))
        extra = {"seq": 0} if kind == "bag" else {}
        return types["std_msgs/msg/Header"](stamp=time, frame_id="world", **extra)

    def rotation(yaw: float):
        return types["geometry_msgs/msg/Quaternion"](*quaternion(yaw))

    messages = []
    for time, yaw in zip(TIMES.tolist(), YAWS.tolist(), strict=True):
        messages.append((time, "/push", "std_msgs/msg/Int32", types["std_msgs/msg/Int32"](data=0)))
        pose = types["geometry_msgs/msg/Pose"](types["geometry_msgs/msg/Point"](time, 0.0, 0.1), rotation(0.0))
        stamped = types["geometry_msgs/msg/PoseStamped"](header(time), pose)
        messages.append((time, "/robot", "geometry_msgs/msg/PoseStamped", stamped))
        moved = types["geometry_msgs/msg/Transform"](types["geometry_msgs/msg/Vector3"](0.3, 0.2, 0.0), rotation(yaw))
        transform = types["geometry_msgs/msg/TransformStamped"](header(time), "cup", moved)
        if kind == "bag":  # the types of ROS 1 come without tf
            messages.append((time, "/cup", "geometry_msgs/msg/TransformStamped", transform))
        else:
            messages.append((time, "/tf", "tf2_msgs/msg/TFMessage", types["tf2_msgs/msg/TFMessage"]([transform])))
    with writer:
        connections = {}
        for time, topic, kind_of_message, message in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind_of_message, typestore=store)
            pack = store.serialize_ros1 if kind == "bag" else store.serialize_cdr
            writer.write(connections[topic], int((1_700_000_000 + time) * 1e9) + 5, pack(message, kind_of_message))
    return path


@pytest.mark.parametrize("kind", ["bag", "SQLITE3", "MCAP"])
def test_bags_of_ros(tmp_path: Path, kind: str) -> None:
    path = write_bag(tmp_path / ("push.bag" if kind == "bag" else "push"), kind)
    sightings = read_sightings(path)
    check(sightings, ("/robot", "cup"), start=1.7e9)
    assert set(sightings.push.tolist()) == {0}
    if kind == "MCAP":
        (file,) = path.glob("*.mcap")
        check(read_sightings(file), ("/robot", "cup"), start=1.7e9)


def write_parquet(folder: Path) -> Path:
    arrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    names = ["robot_x", "robot_y", "robot_yaw", "cup.x", "cup.y", "cup.yaw"]
    states = [[time, 0.0, 0.0, 0.3, 0.2, yaw] for time, yaw in zip(TIMES.tolist(), YAWS.tolist(), strict=True)]
    table = {
        "timestamp": [*TIMES.tolist(), 0.0],
        "episode_index": [0, 0, 0, 1],
        "observation.state": [*states, [9.0] * 6],
        "task": ["push"] * 4,
    }
    path = folder / "data" / "chunk-000" / "episode_000000.parquet"
    path.parent.mkdir(parents=True)
    parquet.write_table(arrow.table(table), path)
    (folder / "meta").mkdir()
    info = {"features": {"observation.state": {"names": {"motors": names}}}}
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    return path


def test_parquet_of_lerobot_by_episode(tmp_path: Path) -> None:
    path = write_parquet(tmp_path)
    check(read_sightings(path, ReadOptions(episode=0)))
    with pytest.raises(TrackError, match="holds episodes 0 to 1; choose one with --episode"):
        read_sightings(path)
    with pytest.raises(TrackError, match="no episode 7; valid: 0, 1"):
        read_sightings(path, ReadOptions(episode=7))
    (tmp_path / "meta" / "info.json").unlink()
    with pytest.raises(TrackError, match=r"no columns such as cup_x.*observation.state\[0\]"):
        read_sightings(path, ReadOptions(episode=0))


@pytest.mark.parametrize("name", ["again.h5", "again.csv"])
def test_sightings_read_back_as_they_were_written(tmp_path: Path, name: str) -> None:
    lines = ["time,node,x,y,yaw,push", "0,杯子,1,2,3,0", "0,/block_1,,,,", "0.5,杯子,1,2,,-1"]
    sightings = read_sightings(written(tmp_path / "names.csv", lines))
    save_sightings(sightings, tmp_path / name)
    again = read_sightings(tmp_path / name)
    assert again.names == sightings.names == ("杯子", "/block_1")
    for column in ("time", "node", "x", "y", "yaw", "push"):
        np.testing.assert_array_equal(getattr(again, column), getattr(sightings, column))


def test_unknown_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(TrackError, match="no such file"):
        read_sightings(tmp_path / "nowhere.csv")
    (tmp_path / "track.doc").write_bytes(b"")
    with pytest.raises(TrackError, match="unknown kind of file; valid: .csv"):
        read_sightings(tmp_path / "track.doc")
    with pytest.raises(TrackError, match="up 'w'; valid: x, y, z"):
        read_sightings(tmp_path / "nowhere.csv", ReadOptions(up="w"))
