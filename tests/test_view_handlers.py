"""The page's own handlers, without a browser: what they do, what they refuse, and that they outlive all of it."""

import json
import os
import random
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import pytest
from scenes import body

from pushgraph.body import Joint
from pushgraph.errors import ViewerError
from pushgraph.scene import Scene
from pushgraph.shape import Cuboid
from pushgraph.tool import Push, Tool

pytest.importorskip("viser", reason="the extra [viewer] is not installed")

from viser import _messages
from visitor import Visitor

from pushgraph.view.page import Page
from pushgraph.view.panel.bodies import SHAPES, BodyControls
from pushgraph.view.panel.files import FileControls
from pushgraph.view.panel.goals import GoalControls
from pushgraph.view.panel.joints import JointControls
from pushgraph.view.panel.outline import OutlineControls
from pushgraph.view.panel.pushes import PushControls
from pushgraph.view.panel.tracks import DeedControls
from pushgraph.view.server import is_foreign
from pushgraph.view.workbench import PREDICTED, SIMULATED

FAILED = "pushgraph failed"
"""How a message begins that tells of a fault of ours."""


def trio() -> Scene:
    """A hinge, a loose body, and a push."""
    plate = body("plate", 0.0, 0.0, Cuboid(size=(0.14, 0.10)))
    lid = body("lid", 0.0, 0.105, Cuboid(size=(0.14, 0.10)), mass=0.3)
    return Scene(
        bodies=(plate, lid, body("cup", 0.25, 0.0)),
        joints=(Joint(kind="revolute", parent="plate", child="lid", anchor=(0.06, 0.0525)),),
        pushes=(Push(start=(-0.2, 0.0), end=(-0.05, 0.0)),),
        tool=Tool.round(0.05),
    )


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    made = tmp_path / "mine"
    made.mkdir()
    (tmp_path / "secret.json").write_text(trio().to_json())
    return made


@pytest.fixture
def page(folder: Path) -> Iterator[Page]:
    with Page(trio(), folder=folder) as served:
        served.ready()
        yield served


@pytest.fixture
def visitor(page: Page, monkeypatch: pytest.MonkeyPatch) -> Visitor:
    return Visitor(page, monkeypatch)


def everything(folder: Path) -> dict[str, bytes]:
    """All files around the page's folder, but those in it."""
    return {str(path): path.read_bytes() for path in folder.parent.glob("*") if path.is_file()}


def test_a_push_is_changed_predicted_simulated_saved_and_undone(page: Page, visitor: Visitor, folder: Path) -> None:
    pushes, deeds, files = page.controls[PushControls], page.controls[DeedControls], page.controls[FileControls]
    before = page.session.workbench.work
    assert list(before.tracks) == [PREDICTED]

    visitor.set(pushes.end, [0.0, 0.0])
    assert visitor.click(pushes, "Change") == ""
    after = page.session.workbench.work
    assert after.scene.pushes[0].end == (0.0, 0.0)
    assert after.tracks[PREDICTED].poses[-1, 1, 0] > before.tracks[PREDICTED].poses[-1, 1, 0] + 0.02

    visitor.click(deeds, "Simulate")
    assert list(page.session.workbench.work.tracks) == [PREDICTED, SIMULATED]
    visitor.set(files.what, "simulated")
    visitor.set(files.name, "mine")
    assert visitor.click(files, "Save") == "Saved mine.h5."
    assert "it is there already" in visitor.click(files, "Save")
    visitor.set(files.replace, True)
    assert visitor.click(files, "Save") == "Saved mine.h5."

    visitor.click(deeds, "Undo")
    assert page.session.workbench.scene == before.scene
    assert "nothing to undo" in visitor.click(deeds, "Undo")
    assert [path.name for path in folder.iterdir()] == ["mine.h5"]


def test_what_is_refused_is_told_in_the_words_of_scene_files(page: Page, visitor: Visitor) -> None:
    bodies, scene = page.controls[BodyControls], page.session.workbench.scene
    visitor.set(bodies.position, [0.02, 0.1])
    said = visitor.click(bodies, "Change")
    content = json.loads(scene.to_json())
    content["bodies"][0]["pose_world_from_body"][:2] = [0.02, 0.1]
    content["joints"][0]["anchor"] = [0.08, 0.1525]
    with pytest.raises(Exception, match="overlap") as refused:
        Scene.from_json(json.dumps(content))
    assert said == str(refused.value)
    assert page.session.workbench.scene is scene


def test_what_takes_long_is_cancelled_by_a_button_that_then_appears(page: Page, visitor: Visitor) -> None:
    working, before = page.session.working, page.session.workbench.work

    def endless() -> None:
        while True:
            working.tell(1, 10)
            time.sleep(0.01)

    assert not working.seen
    page.session.do(lambda: None).result()
    assert not working.seen
    asked = page.session.do(endless)
    while not working.seen:
        time.sleep(0.01)
    visitor.set(working.button, True)
    asked.result(30)
    assert not working.seen
    assert page.session.message == "Cancelled; everything is as it was."
    assert page.session.workbench.work is before


def test_a_polygon_is_drawn_by_clicks_and_checked_as_scene_files_are(page: Page, visitor: Visitor) -> None:
    controls, bench = page.controls[OutlineControls], page.session.workbench
    assert "none was begun" in visitor.click(controls, "Close")
    visitor.click(controls, "Draw")

    def click(x: float, y: float) -> None:
        before = list(controls.corners)
        eye = (x, y - 1.0, 1.0)
        visitor.send(_messages.ScenePointerMessage("click", eye, (0.0, 1.0, -1.0), ((0.5, 0.5),), None))
        while controls.corners == before:
            time.sleep(0.01)

    for corner in ((0.30, 0.30), (0.40, 0.30), (0.30, 0.40), (0.40, 0.40), (0.35, 0.50)):
        click(*corner)
    visitor.click(controls, "Back")
    assert "shape.points: the outline crosses or touches itself" in visitor.click(controls, "Close")
    assert len(controls.corners) == 4
    for _ in range(2):
        visitor.click(controls, "Back")
    for corner in ((0.40, 0.40), (0.30, 0.40)):
        click(*corner)
    visitor.click(controls, "Close")
    added = bench.planar.bodies[-1]
    assert added.pose_world_from_body == (0.35, 0.35, 0.0)
    assert added.shape.points == ((-0.05, -0.05), (0.05, -0.05), (0.05, 0.05), (-0.05, 0.05))
    assert controls.corners == []
    assert not controls.drawing
    bench.undo()


def test_two_browsers_share_one_state(page: Page, visitor: Visitor, monkeypatch: pytest.MonkeyPatch) -> None:
    other, pushes = Visitor(page, monkeypatch), page.controls[PushControls]
    visitor.click(pushes, "Add")
    other.click(pushes, "Add")
    visitor.connection.close()
    other.click(pushes, "Delete")
    assert len(page.session.workbench.scene.pushes) == 2


@pytest.mark.parametrize("count", [12, pytest.param(200, marks=pytest.mark.slow)])
def test_random_edits_leave_the_server_alive(page: Page, visitor: Visitor, folder: Path, count: int) -> None:
    rng, outside = random.Random(count), everything(folder)
    refused = 0
    for _ in range(count):
        scene = page.session.workbench.scene
        said = random_edit(page, visitor, rng)
        assert FAILED not in said
        changed = page.session.workbench.scene is not scene
        refused += not changed and bool(said)
        assert changed or said or page.session.workbench.scene == scene
    assert 0.1 * count < refused < 0.9 * count
    assert urlopen(page.url).status == 200
    assert everything(folder) == outside
    assert all(path.suffix == ".json" and path.parent == folder for path in folder.rglob("*"))


def random_edit(page: Page, visitor: Visitor, rng: random.Random) -> str:
    """Type numbers and names, valid or not, and click."""
    names = [*page.session.workbench.scene.names, "nobody", "", "robot", "a\nb", "<img src=x>", "x" * 500]

    def number() -> float:
        return rng.choice([rng.uniform(-0.6, 0.6)] * 6 + [0.0, -1.0, 1e9, float("nan"), float("inf"), 1e-12])

    def place() -> list[float]:
        return [number(), number()]

    kind = rng.choice([PushControls, BodyControls, JointControls, GoalControls, DeedControls, FileControls])
    controls = page.controls[kind]
    if kind is PushControls:
        visitor.set(controls.push, rng.choice(["1", "2", "-1", "99", "one", "²"]))
        for control, value in ((controls.start, place()), (controls.end, place()), (controls.speed, number())):
            visitor.set(control, value)
        return visitor.click(controls, rng.choice(["Change", "Change", "Add", "Delete"]))
    if kind is BodyControls:
        visitor.set(controls.body, rng.choice(names))
        visitor.set(controls.name, rng.choice([*names, "new"]))
        visitor.set(controls.shape, rng.choice([*SHAPES, "ball"]))
        visitor.set(controls.size, [abs(number()) / 5, abs(number()) / 5])
        visitor.set(controls.mass, number())
        visitor.set(controls.position, place())
        visitor.set(controls.yaw, 90 * number())
        return visitor.click(controls, rng.choice(["Change", "Add", "Delete"]))
    if kind is JointControls:
        for control in (controls.parent, controls.child):
            visitor.set(control, rng.choice(names))
        visitor.set(controls.kind, rng.choice(["fixed", "revolute", "prismatic", "ball"]))
        return visitor.click(controls, rng.choice(["Join", "Part"]))
    if kind is GoalControls:
        visitor.set(controls.body, rng.choice(names))
        visitor.set(controls.position, place())
        return visitor.click(controls, "Set")
    if kind is DeedControls:
        return visitor.click(controls, rng.choice(["Undo", "Simulate"]))
    visitor.set(controls.what, rng.choice(["scene", "plan", "everything"]))
    visitor.set(controls.name, rng.choice(["../out", "/tmp/out", "a", "b.json", "..", "a/b", "C:\\x", "\0", ".hidden"]))
    return visitor.click(controls, "Save")


def test_malformed_files_are_refused_by_name(page: Page, visitor: Visitor, folder: Path) -> None:
    outside, controls = everything(folder), page.controls[FileControls]
    work = page.session.workbench.work
    names = malformed_files(folder, random.Random(0))
    assert len(names) >= 50
    for name in names:
        visitor.set(controls.file, name)
        said = visitor.click(controls, "Load")
        assert FAILED not in said
        assert Path(name).name in said or repr(name) in said, (name, said)
        assert page.session.workbench.work is work, name
    assert everything(folder) == outside
    assert urlopen(page.url).status == 200


def malformed_files(folder: Path, rng: random.Random) -> list[str]:
    """Put them there, and return what somebody might ask for: also what is elsewhere, or no file."""
    text = trio().to_json()
    names = ["../secret.json", "/etc/passwd", str(folder.parent / "secret.json"), "missing.json", "", ".", "sub"]
    names += ["sub/../../secret.json", "link.json", "sublink/secret.json", "pipe.json", "a\0.json", "x" * 300]
    (folder / "sub").mkdir()
    (folder / "link.json").symlink_to(folder.parent / "secret.json")
    (folder / "sublink").symlink_to(folder.parent)
    os.mkfifo(folder / "pipe.json")
    with (folder / "huge.json").open("wb") as file:
        file.truncate(65 * 2**20)
    names.append("huge.json")
    contents = {
        "empty.json": "", "null.json": "null", "list.json": "[" * 100_000, "number.json": "1e999", "latin.json": "\xff",
        "other.json": '{"format": "something"}', "version.json": text.replace('"version": 1', '"version": 2'),
        "beliefs.json": '{"format": "pushgraph.beliefs", "version": 3}', "page.html": "<html>", "old.json": "{}",
        "plan.json": '{"format": "pushgraph.plan", "version": 1, "cost": NaN}', "no.h5": "no HDF5", "no.csv": "a,b\n1",
        "twice.json": '{"format": "pushgraph.scene", "format": "pushgraph.scene"}', "numbers.csv": "time\n0\n",
        "lever.json": '{"format": "pushgraph.lever-scene", "version": 1}', "cut.h5": "\x89HDF\r\n\x1a\n" + "\0" * 64,
    }  # fmt: skip
    for name, content in contents.items():
        (folder / name).write_text(content, encoding="latin-1")
    names += contents
    for index in range(20):
        (folder / f"cut-{index}.json").write_text(text[: rng.randrange(1, len(text) - 2)])
        names.append(f"cut-{index}.json")
    return names


def test_garbage_on_the_wire_costs_only_whoever_sends_it(page: Page, visitor: Visitor) -> None:
    rng = random.Random(0)
    for _ in range(10):
        other = Visitor(page, pytest.MonkeyPatch())
        other.connection.send(rng.choice([rng.randbytes(64), b"", b"\x80", "text", b"\x81\xa4type\xa1x"]))
    assert visitor.click(page.controls[PushControls], "Add") == ""


def test_other_sites_and_other_machines_are_kept_out(page: Page) -> None:
    assert urlopen(page.url).status == 200
    for header in ({"Host": "evil.example"}, {"Origin": "http://evil.example"}, {"Origin": "null"}):
        with pytest.raises(HTTPError, match="403"):
            urlopen(Request(page.url, headers=header))
    assert not is_foreign("0.0.0.0", ["desk:8080"], ["http://desk:8080"])
    assert is_foreign("0.0.0.0", ["desk:8080"], ["http://evil.example:8080"])
    assert page.session.server.request_share_url() is None


def test_a_used_port_gets_a_free_one_and_says_so(page: Page, folder: Path) -> None:
    port = int(page.url.rsplit(":", 1)[1])
    with Page(trio(), folder=folder, port=port) as other:
        assert other.url != page.url
        assert str(port) in other.said[0]
    with Page(trio(), folder=folder, host="0.0.0.0") as wide:
        assert "no password" in wide.said[-1]
    for host, wrong in (("nowhere.invalid", 8080), ("127.0.0.1", 0), ("127.0.0.1", 70_000)):
        with pytest.raises(ViewerError, match=r"host|port"):
            Page(trio(), folder=folder, host=host, port=wrong)


def test_a_script_shows_a_scene_and_a_notebook_a_page(folder: Path, capsys: pytest.CaptureFixture) -> None:
    import pushgraph as pg
    import pushgraph.view  # a package of the same name, which does not hide the function

    scene = trio()
    track = pg.load().predict(scene)
    with pytest.warns(UserWarning, match="no password"), pg.view(scene, folder=folder, host="0.0.0.0", wait=False):
        pass
    with pg.view(track, compare=pg.simulate(scene), folder=folder, wait=False) as shown:
        shown.ready()
        assert list(shown.session.workbench.work.tracks) == ["Opened", "Compared"]
        assert f'src="{shown.url}"' in shown._repr_html_()
    with pytest.raises(pg.PushGraphError, match="compare: its bodies are"):
        pg.view(scene, compare=pg.load().predict(Scene(bodies=(body("other", 0.0, 0.0),))), folder=folder, wait=False)


def test_without_the_extra_one_sentence_says_what_is_missing() -> None:
    code = "import sys; sys.modules['viser'] = None; from pushgraph.cli import main; main(['view'])"
    refused = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert refused.returncode == 1
    assert refused.stderr.strip() == "Error: the browser viewer needs viser: pip install 'pushgraph[viewer]'"
