"""What the commands do with scenes in space: levering a board up."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rich.table import Table

from pushgraph.cli.choices import Animation
from pushgraph.cli.drawing import draw
from pushgraph.cli.output import console, say_files
from pushgraph.errors import SceneError

if TYPE_CHECKING:
    from pushgraph.lever_scene import LeverScene
    from pushgraph.lever_track import LeverTrack

MOMENTS = 7
"""So many moments of a rollout are told."""



def lever_scene(path: Path) -> "LeverScene | None":
    """The scene in a file if that holds one in space; None if it holds anything else, or cannot be read."""
    from pushgraph.lever_scene import LeverScene
    from pushgraph.scene_file import header, read

    try:
        text = read(path)
        if header(text, str(path)).get("format") != LeverScene.format_name():
            return None
    except SceneError:
        return None
    return LeverScene.from_json(text, str(path))


def predict_lever_scene(scene: "LeverScene", model: str, out: Path, animation: Animation | None) -> None:
    """Predict by a shipped predictor or a checkpoint, and write what `write_lever_tracks` does."""
    from pushgraph.lever_physics import LeverPredictor

    predictor = LeverPredictor.load(model)
    with console.status("Predicting"):
        track = predictor.predict(scene)
    write_lever_tracks({"Predicted": track}, out, animation)


def simulate_lever_scene(scene: "LeverScene", out: Path, animation: Animation | None) -> None:
    """Simulate in MuJoCo, and write what `write_lever_tracks` does."""
    from pushgraph.simulation.lever import simulate_lever

    with console.status("Simulating"):
        track = simulate_lever(scene)
    write_lever_tracks({"Simulated": track}, out, animation)


def compare_lever_scene(scene: "LeverScene", model: str, out: Path, animation: Animation | None) -> None:
    """Predict and simulate, and write what `write_lever_tracks` does of both."""
    from pushgraph.lever_physics import LeverPredictor
    from pushgraph.simulation.lever import simulate_lever

    predictor = LeverPredictor.load(model)
    with console.status("Predicting"):
        predicted = predictor.predict(scene)
    with console.status("Simulating"):
        simulated = simulate_lever(scene)
    console.print(board_differences(predicted, simulated))
    write_lever_tracks({"Simulated": simulated, "Predicted": predicted}, out, animation)


def write_lever_tracks(tracks: Mapping[str, "LeverTrack"], out: Path, animation: Animation | None) -> None:
    """Write tracks of one scene, by title, what shows them side by side, if that can be drawn, and a table of where the
    board ended."""
    outputs = [out / ("track.h5" if len(tracks) == 1 else f"{title.lower()}.h5") for title in tracks]
    for track, path in zip(tracks.values(), outputs, strict=True):
        track.save(path)
    if animation is not None:
        from pushgraph.viewer.lever import save_lever_animation, save_lever_picture

        outputs += draw(out, animation, partial(save_lever_picture, tracks), partial(save_lever_animation, tracks))
    console.print(final_board_poses(tracks))
    say_files(outputs)


def board_differences(predicted: "LeverTrack", simulated: "LeverTrack") -> Table:
    """How far a predicted board is from the simulated one, over the rollout."""
    from pushgraph import pose_3d

    table = Table(title="Predicted against simulated")
    for name in ("time (s)", "moved (mm)", "turned (deg)", "rise (mm)", "position off (mm)", "rotation off (deg)"):
        table.add_column(name, justify="right")
    frames = np.linspace(0, len(simulated.poses) - 1, MOMENTS).round().astype(int)
    start = simulated.board[0]
    for frame in frames:
        true, found = simulated.board[frame], predicted.board[frame]
        moved, off = (1e3 * np.linalg.norm((pose - true)[:3]) for pose in (start, found))
        turned, turned_off = (np.degrees(pose_3d.rotation_error(pose, true)) for pose in (start, found))
        numbers = (simulated.times[frame], moved, turned, 1e3 * simulated.rise[frame], off, turned_off)
        table.add_row(*(f"{round(number, 2) + 0.0:.2f}" for number in numbers))  # no -0.00
    raised = ", ".join(
        f"{name} {'raised' if track.raised else 'not raised'}"
        for name, track in (("predicted", predicted), ("simulated", simulated))
    )
    table.caption = f"at the end: {raised}"
    return table


def final_board_poses(tracks: Mapping[str, "LeverTrack"]) -> Table:
    """Where the board ended in each track."""
    from pushgraph import pose_3d
    from pushgraph.lever_track import RAISED

    first = next(iter(tracks.values()))
    table = Table(title=f"The board after {first.times[-1]:.2f} s")
    columns = ("x (m)", "y (m)", "z (m)", "moved (mm)", "turned (deg)", "rise (mm)", "overlap (mm)")
    for name in ("", *columns):
        table.add_column(name, justify="right" if name else "left", no_wrap=not name)
    for title, track in tracks.items():
        start, end = track.board[0], track.board[-1]
        turned = np.degrees(pose_3d.rotation_error(start, end))
        moved, rise, deep = (
            1e3 * v for v in (np.linalg.norm((end - start)[:3]), track.rise[-1], track.penetration.max())
        )
        table.add_row(
            title, *(f"{v:.4f}" for v in end[:3]), f"{moved:.1f}", f"{turned:.1f}", f"{rise:.1f}", f"{deep:.2f}"
        )
    table.caption = f"rise: of its highest point; from {RAISED * 1e3:g} mm on it counts as raised"
    return table
