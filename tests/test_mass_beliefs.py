"""What is believed of masses: in files, commands and pictures."""

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scenes import body

from pushgraph import load
from pushgraph.belief import BeliefModel
from pushgraph.belief_history import FRAMES_PER_WEIGHING, BeliefHistory
from pushgraph.believed_mass import BelievedMass
from pushgraph.cli import main
from pushgraph.cli.beliefs import masses_table
from pushgraph.cli.scenes import load_scene
from pushgraph.errors import BeliefError
from pushgraph.mass_history import MassHistory
from pushgraph.mass_prior import MASS_CLASSES
from pushgraph.scene import Scene, Table
from pushgraph.simulation.planar import simulate
from pushgraph.tool import Push, Tool
from pushgraph.track import Track
from pushgraph.viewer.beliefs import mass_colours, save_beliefs, telling_bodies

CLASSES = [one.name for one in MASS_CLASSES]


def chain() -> Scene:
    """A disc that pushes another."""
    return Scene(
        bodies=(body("near", 0.0, 0.0, mass=1.5), body("far", 0.13, 0.02, mass=0.4)),
        pushes=(Push(start=(-0.11, 0.0), end=(0.02, 0.0)),),
        tool=Tool.round(0.05),
    )


def without_mass(scene: Scene, *names: str) -> Scene:
    return scene.replace(bodies=tuple(b.replace(mass=None) if b.name in names else b for b in scene.bodies))


@pytest.fixture(scope="module")
def model() -> BeliefModel:
    return BeliefModel.load("belief")


@pytest.fixture(scope="module")
def track() -> Track:
    return simulate(chain())


@pytest.fixture(scope="module")
def history(model, track) -> BeliefHistory:
    return BeliefHistory.watch(chain(), track, model, weigh=True)


@pytest.fixture(scope="module")
def files(track, history, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("masses")
    (folder / "scene.json").write_text(chain().to_json())
    (folder / "unknown.json").write_text(without_mass(chain(), "far").to_json())
    track.save(folder / "track.h5")
    history.save(folder / "beliefs.json")
    return folder


def run(*arguments: object) -> int:
    with pytest.raises(SystemExit) as exit_:
        main([str(argument) for argument in arguments])
    return exit_.value.code


def words(text: str) -> str:
    """Without the frames and line breaks of tables and errors."""
    return " ".join("".join(" " if letter in "│╭╮╰╯─" else letter for letter in text).split())


def test_masses_are_asked_for_at_some_frames_and_in_the_end(history, track) -> None:
    masses = history.mass_history
    frames = sorted({*range(0, len(track.times), FRAMES_PER_WEIGHING), len(track.times) - 1})
    np.testing.assert_allclose(masses.times, track.times[frames])
    assert (list(masses.classes), [mass.body for mass in history.masses]) == (CLASSES, ["near", "far"])
    for column, mass in enumerate(history.masses):
        assert masses.probabilities[-1, column].tolist() == list(mass.classes.values())
        assert tuple(masses.quantiles[-1, column]) == mass.mass
        assert history.scene.bodies[column].mass == mass.mass[0]
    np.testing.assert_allclose(masses.probabilities[0], 1 / 3, atol=0.02)


def test_only_masses_that_a_scene_leaves_out_are_learnt_unless_all_are_weighed(model, track) -> None:
    assert BeliefHistory.watch(chain(), track, model).mass_history is None
    some = BeliefHistory.watch(without_mass(chain(), "far"), track, model)
    assert [mass.body for mass in some.masses] == ["far"]
    assert some.scene.bodies[0].mass == 1.5


def test_the_force_sensor_of_a_track_tells_what_no_motion_can(model) -> None:
    scene = chain().replace(bodies=chain().bodies[:1])
    track = simulate(scene)
    (blind,) = BeliefHistory.watch(scene, dataclasses.replace(track, wrench=None), model, weigh=True).masses
    (felt,) = BeliefHistory.watch(scene, track, model, weigh=True).masses
    assert max(blind.classes.values()) < 0.5
    assert felt.classes["normal"] > 0.9


def test_the_table_s_friction_is_learnt_where_a_mass_and_the_force_are_known(model, tmp_path) -> None:
    slippery = chain().replace(table=Table(friction=0.3))
    told = without_mass(slippery, "far").replace(table=Table(friction=None))
    history = BeliefHistory.watch(told, simulate(slippery), model)
    friction = history.mass_history.friction
    assert friction.shape == (len(history.mass_history.times), 3)
    np.testing.assert_allclose(friction[0], [0.4, 0.264, 0.536], atol=0.05)
    median, low, high = friction[-1]
    assert median == pytest.approx(0.3, abs=0.04)
    assert high - low < 0.1
    history.save(tmp_path / "beliefs.json")
    np.testing.assert_allclose(BeliefHistory.load(tmp_path / "beliefs.json").mass_history.friction, friction, atol=1e-5)


def test_a_file_keeps_them(history, files) -> None:
    read = BeliefHistory.load(files / "beliefs.json")
    assert read.masses == history.masses
    for name in ("times", "probabilities", "quantiles"):
        kept, was = (getattr(one.mass_history, name) for one in (read, history))
        np.testing.assert_allclose(kept, was, atol=1e-5)
    weighed = read.apply_masses(chain().moved((0.3, 0.1, 1.0)))
    assert weighed == chain().moved((0.3, 0.1, 1.0)).replace(bodies=weighed.bodies)
    assert [b.mass for b in weighed.bodies] == [mass.mass[0] for mass in history.masses]


def test_masses_of_other_bodies_or_none_are_not_applied(history, model, track) -> None:
    other = chain().replace(bodies=chain().bodies[:1])
    with pytest.raises(BeliefError, match="these beliefs are about near, far; the scene has near"):
        history.apply_masses(other)
    with pytest.raises(BeliefError, match="hold no masses.*--masses unknown"):
        BeliefHistory.watch(chain(), track, model).apply_masses(chain())


def edited(place: list, value: object) -> Callable[[dict], None]:
    def edit(content: dict) -> None:
        *way, last = place
        for key in way:
            content = content[key]
        content[last] = value

    return edit


@pytest.mark.parametrize(
    ("edit", "says"),
    [
        (edited(["version"], 2), "version 2 of beliefs; this pushgraph reads 3"),
        (edited(["masses"], [1]), "damaged"),
        (lambda content: content.pop("masses"), "damaged"),
        (lambda content: content["masses"]["believed"][0].pop("slide"), "damaged"),
        (
            edited(["masses", "classes"], ["light", "medium", "heavy"]),
            "masses: the classes are light, medium, heavy; those of the scene are light, normal, heavy",
        ),
        (
            edited(["scene", "mass_classes"], [{"name": "light", "lowest": 0.1, "highest": 1}]),
            "of the scene are light$",
        ),
        (edited(["masses", "believed", 0, "classes"], {"light": 1.0}), "'near': classes must be light, normal, heavy"),
        (edited(["masses", "believed", 0, "body"], "cup"), "'cup' is no body of the scene; valid: near, far"),
        (edited(["masses", "believed", 0, "ratios"], {"cup": [1, 1, 1]}), "'cup' is no body of the scene"),
        (edited(["masses", "believed", 0, "body"], "far"), "a body stands there twice: far, far"),
        (edited(["masses", "believed", 1, "mass"], [0.5, 0.6, 0.7]), "'far': .* 0 < low <= median <= high"),
        (edited(["masses", "believed", 1, "slide"], [0.5, float("nan"), 0.7]), "slide.1.: .* finite"),
        (edited(["masses", "believed", 1, "ratios", "near"], [1, -1, 2]), "'far': .* 0 < low"),
        (edited(["masses", "times"], [0.0]), "probabilities: shape must be"),
        (edited(["masses", "times", 1], 0.0), "finite times that rise"),
        (edited(["masses", "probabilities", 0, 0], [0.5, 0.5, 0.5]), "at least 0, and 1 together"),
        (edited(["masses", "probabilities", 0, 0], [1.5, -0.5, 0.0]), "at least 0, and 1 together"),
        (edited(["masses", "quantiles", 0, 0], [1.0, 2.0, 3.0]), "low <= median"),
    ],
)
def test_damaged_masses_are_refused(files, tmp_path, edit, says) -> None:
    content = json.loads((files / "beliefs.json").read_text())
    del content["checksum"]
    edit(content)
    path = tmp_path / "beliefs.json"
    path.write_text(json.dumps(content))
    with pytest.raises(BeliefError, match=says) as raised:
        BeliefHistory.load(path)
    assert str(path) in str(raised.value)


def test_observe_prints_and_writes_what_weighs_how_much(files, tmp_path, capsys, monkeypatch) -> None:
    monkeypatch.setenv("COLUMNS", "120")
    arguments = ("observe", files / "scene.json", files / "track.h5", "--masses", "unknown", "--out", tmp_path)
    assert run(*arguments) == 0
    printed = words(capsys.readouterr().out)
    assert "Masses after" in printed
    assert "kilograms follow from the table's friction, 0.45" in printed
    read = BeliefHistory.load(tmp_path / "beliefs.json")
    assert [mass.body for mass in read.masses] == ["near", "far"]
    assert f"{read.masses[0].mass[0]:.2f}" in printed
    written = Scene.load(tmp_path / "scene.json")
    assert [b.mass for b in written.bodies] == [mass.mass[0] for mass in read.masses]


def test_observe_learns_only_what_the_scene_leaves_out(files, tmp_path, capsys) -> None:
    assert run("observe", files / "scene.json", files / "track.h5", "--out", tmp_path) == 0
    assert "Masses after" not in capsys.readouterr().out
    assert json.loads((tmp_path / "beliefs.json").read_text())["masses"] is None
    assert run("observe", files / "unknown.json", files / "track.h5", "--out", tmp_path) == 0
    assert "Masses after" in capsys.readouterr().out
    assert [mass.body for mass in BeliefHistory.load(tmp_path / "beliefs.json").masses] == ["far"]


def test_a_belief_without_masses_says_so(files, tmp_path, capsys) -> None:
    arguments = ("--model", "paper_recipe", "--masses", "unknown", "--out", tmp_path)
    assert run("observe", files / "scene.json", files / "track.h5", *arguments) == 0
    assert "No mass was learnt: paper_recipe says nothing of masses" in words(capsys.readouterr().out)


def test_predict_takes_believed_masses_with_given_joints(files, history, tmp_path) -> None:
    common = ("predict", files / "unknown.json", "--animation", "none", "--out", tmp_path)
    assert run(*common, "--masses", "believed", "--beliefs", files / "beliefs.json") == 0
    predicted = Track.load(tmp_path / "track.h5")
    assert predicted.scene == history.apply_masses(chain())
    np.testing.assert_allclose(predicted.poses, load().predict(history.apply_masses(chain())).poses, atol=1e-9)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--masses", "believed"], "needs --beliefs"),
        (["--relations", "believed"], "needs --beliefs"),
        (["--beliefs", "beliefs.json"], "needs --relations believed or --masses believed"),
        (["--masses", "light"], "not one of 'given', 'mean', 'believed'"),
    ],
)
def test_predict_refuses_what_does_not_go_together(arguments, says, capsys) -> None:
    assert run("predict", "demo", *arguments) == 2
    assert says in words(capsys.readouterr().err)


def test_observe_refuses_other_words_and_classes_that_overlap(files, tmp_path, capsys) -> None:
    assert run("observe", files / "scene.json", files / "track.h5", "--masses", "mean") == 2
    assert "not one of 'given', 'unknown'" in words(capsys.readouterr().err)
    content = json.loads(chain().to_json())
    content["mass_classes"] = [
        {"name": "light", "lowest": 0.1, "highest": 1.0},
        {"name": "heavy", "lowest": 0.9, "highest": 2.0},
    ]
    (tmp_path / "scene.json").write_text(json.dumps(content))
    assert run("observe", tmp_path / "scene.json", files / "track.h5") == 1
    said = words(capsys.readouterr().err)
    assert "mass_classes: 'light' ends at 1 kg, beyond where 'heavy' begins, 0.9 kg; classes must not overlap" in said


def believed(name: str, mass: tuple[float, float, float], **ratios: tuple[float, float, float]) -> BelievedMass:
    return BelievedMass(name, dict.fromkeys(CLASSES, 1 / 3), mass, mass, ratios)


def test_the_table_says_what_kilograms_stand_on_and_of_what_they_cannot_be_told() -> None:
    scene = chain()
    masses = [believed("near", (1.5, 0.3, 9.0), far=(3.0, 2.0, 4.0)), believed("far", (0.4, 0.3, 0.45))]
    moving = masses_table("Masses", masses, scene, sensor=False).caption
    assert "Motion tells ratios of masses only; kilograms follow through the classes: light 0.2 to 0.5" in moving
    assert "Kilograms cannot be told yet of near: the intervals span classes." in moving
    slippery = scene.replace(table=scene.table.replace(friction=None))
    assert "the table's friction is unknown" in masses_table("Masses", masses, slippery, sensor=True).caption
    told = masses_table("Masses", masses[1:], scene, sensor=True)
    assert "cannot be told" not in told.caption
    ratios = list(masses_table("Masses", masses, scene, sensor=True).columns[-1].cells)
    assert ratios == ["3.00 x far\n(2.00-4.00)", "alone"]


def test_the_picture_has_masses_beside_joints_if_any_were_learnt(history, tmp_path) -> None:
    sizes = []
    for number, one in enumerate((history, dataclasses.replace(history, mass_history=None))):
        save_beliefs(one, tmp_path / f"{number}.png")
        with Image.open(tmp_path / f"{number}.png") as picture:
            sizes.append(picture.size[0])
    assert sizes[0] > 1.5 * sizes[1]


def test_the_heavier_a_class_the_darker_and_only_the_most_telling_bodies_are_shown() -> None:
    brightness = {
        name: sum(int(colour[k : k + 2], 16) for k in (1, 3, 5))
        for name, colour in mass_colours(MASS_CLASSES[::-1]).items()
    }
    assert list(brightness) == CLASSES[::-1]
    assert brightness["light"] > brightness["normal"] > brightness["heavy"]
    probabilities = np.full((2, 20, 3), 1 / 3)
    probabilities[1, 3:] = [1.0, 0.0, 0.0]
    masses = MassHistory(CLASSES, np.arange(2.0), probabilities, np.ones((2, 20, 3)), [])
    assert telling_bodies(masses) == list(range(3, 19))


def test_the_shipped_scene_s_bodies_weigh_what_its_classes_say() -> None:
    scene = load_scene("demo")
    for each in scene.bodies:
        assert any(one.lowest <= each.mass <= one.highest for one in scene.classes_of_mass), each.name
