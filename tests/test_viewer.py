"""Pictures and animations: names off the lines, legends, every frame; the command that compares."""

import io
from pathlib import Path

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image
from scenes import workshop

import pushgraph as pg
from pushgraph.cli import main
from pushgraph.simulation.planar import simulate
from pushgraph.track import Track
from pushgraph.viewer.animation import save_animation
from pushgraph.viewer.drawing import prepare
from pushgraph.viewer.names import place_names
from pushgraph.viewer.picture import draw_ends, draw_scene


@pytest.fixture(scope="module")
def track() -> Track:
    return simulate(workshop())


def test_a_name_gives_way_to_lines_and_other_names() -> None:
    figure = Figure(figsize=(4, 4))
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    prepare(axes, (-1.0, 1.0, -1.0, 1.0), "")
    axes.plot([-1.0, 1.0], [0.0, 0.0])
    names = [axes.text(0.0, 0.0, "body", ha="center", va="center") for _ in range(2)]
    free = axes.text(0.0, 0.7, "free", ha="center", va="center")
    place_names(figure, [(axes, [*names, free])])
    figure.draw_without_rendering()
    boxes = [name.get_window_extent() for name in names]
    line = axes.transData.transform((0.0, 0.0))[1]
    assert all(box.y0 > line or box.y1 < line for box in boxes)
    assert not boxes[0].overlaps(boxes[1])
    # None moves farther than it has to, and what is free stays.
    assert all(abs(np.mean([box.y0, box.y1]) - line) < 2 * box.height for box in boxes)
    assert free.get_position() == pytest.approx((0.0, 0.7))


def test_the_legend_names_every_mark_and_line_that_is_there(track: Track) -> None:
    def words(figure: Figure) -> set[str]:
        (legend,) = figure.legends
        return {text.get_text() for text in legend.get_texts()}

    scene = workshop()
    joints = {f"{joint.kind} joint" for joint in scene.joints}
    assert joints
    assert words(draw_scene(scene)) == {"push of the tool", *joints}
    assert not draw_scene(pg.Scene(bodies=scene.bodies[:1])).legends
    figure = Figure(figsize=(16, 6), layout="constrained")
    draw_ends(figure, {"Predicted": track, "Simulated": track})
    paths = {"path of a body's origin", "path of the tool"}
    assert words(figure) == {"push of the tool", *joints, *paths, "outlines as predicted"}


def test_an_animation_shows_every_frame_and_says_which_push(track: Track, tmp_path: Path) -> None:
    save_animation({"One": track, "Two": track}, tmp_path / "a.gif")
    with Image.open(tmp_path / "a.gif") as animation:
        durations, pictures = [], []
        for frame in range(animation.n_frames):
            animation.seek(frame)
            durations.append(animation.info["duration"])
            pictures.append(np.asarray(animation.convert("RGB")).astype(int))
    # Frames that are alike are one, shown longer.
    assert sum(durations) == 50 * len(track.times)
    assert len(pictures) > 0.7 * len(track.times)
    # Only the panels change, both alike; ticks and labels stay.
    changed = np.abs(pictures[-1] - pictures[0]).sum(-1) > 60
    left, right = np.split(changed, 2, axis=1)
    assert left[60:].any()
    assert (left[60:] == right[60:]).mean() > 0.99
    assert not changed[:, :40].any()


def test_notebooks_show_scenes_and_tracks(track: Track) -> None:
    for shown, wide in ((track, True), (workshop(), False)):
        with Image.open(io.BytesIO(shown._repr_png_())) as picture:
            assert (picture.size[0] > picture.size[1]) == wide
            assert len(picture.convert("RGB").getcolors(100_000)) > 50


def test_a_scene_without_pushes_is_shown(tmp_path: Path) -> None:
    still = workshop().replace(pushes=())
    pg.save_picture(still, tmp_path / "scene.png")
    pg.save_picture(simulate(still), tmp_path / "track.png")
    assert all((tmp_path / f"{name}.png").stat().st_size > 5_000 for name in ("scene", "track"))


def test_compare_shows_how_far_off_the_prediction_of_any_scene_is(tmp_path: Path, capsys) -> None:
    scene = workshop()
    path, out = tmp_path / "scene.json", tmp_path / "out"
    unknown = scene.replace(bodies=(scene.bodies[0].replace(mass=None), *scene.bodies[1:]))
    path.write_text(unknown.to_json())
    with pytest.raises(SystemExit) as stop:
        main(["compare", str(path), "--out", str(out)])
    assert stop.value.code == 0
    assert {one.name for one in out.iterdir()} == {"predicted.h5", "simulated.h5", "picture.png", "animation.gif"}
    simulated = Track.load(out / "simulated.h5")
    assert simulated.poses.tobytes() == simulate(unknown.with_nominal_values()).poses.tobytes()
    predicted = Track.load(out / "predicted.h5")
    printed = capsys.readouterr().out
    assert f"mass of {scene.bodies[0].name!r} is unknown: taken as 0.6 kg" in printed
    off = 100 * np.hypot(*(predicted.poses - simulated.poses)[-1, 1:, :2].T)
    for name, distance in zip(scene.names, off, strict=True):
        (row,) = (line for line in printed.splitlines() if line.split()[1:2] == [name])
        assert f"{distance:.1f}" in row
    with pytest.raises(SystemExit) as stop:
        main(["compare", "lever-up", "--out", str(out / "space"), "--animation", "none"])
    assert stop.value.code == 0
    assert {one.name for one in (out / "space").iterdir()} == {"predicted.h5", "simulated.h5", "picture.png"}
