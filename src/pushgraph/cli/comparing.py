"""The commands compare and demo: predicted against simulated."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import numpy as np
import typer
from rich.table import Table

from pushgraph.cli.beliefs import joints_table, masses_table
from pushgraph.cli.choices import Animation
from pushgraph.cli.drawing import draw, drawable
from pushgraph.cli.lever import compare_lever_scene, lever_scene
from pushgraph.cli.output import console, say_files, warn
from pushgraph.cli.scenes import (
    SPREAD_CAPTION,
    SPREAD_COLUMNS,
    ResultFolder,
    SceneName,
    load_scene,
    scene_path,
    shipped_scenes,
    stated_at_the_end,
)

if TYPE_CHECKING:
    from pushgraph.physics import PhysicsPredictor
    from pushgraph.regulator import BeliefRegulator
    from pushgraph.scene import Scene
    from pushgraph.track import Track
    from pushgraph.viewer.beliefs import Moment


class Compared(NamedTuple):
    """A scene as it was predicted and simulated, and the files that show it."""

    predicted: "Track"
    simulated: "Track"
    outputs: list[Path]


def compare(
    scene: SceneName,
    out: ResultFolder = None,
    model: Annotated[
        str | None,
        typer.Option(
            help="contact, propnet, image, or a checkpoint; of scenes in space lever_up or a checkpoint.",
            show_default="contact, lever_up",
        ),
    ] = None,
    animation: Annotated[Animation, typer.Option(help="mp4 needs ffmpeg.")] = Animation.GIF,
) -> None:
    """Predict a scene's pushes, simulate the same, and compare: tracks, picture, animation, a table of how far off.

    Examples:

    `pushgraph compare scene.json --out compared`

    `pushgraph compare demo --model propnet --animation none`
    """
    from pushgraph.physics import PhysicsPredictor

    drawn = drawable(animation)
    folder = out or Path(Path(scene).stem)
    in_space = lever_scene(scene_path(scene))
    if in_space is not None:
        compare_lever_scene(in_space, model or "lever_up", folder, drawn)
        return
    compared = compare_scene(load_scene(scene), PhysicsPredictor.load(model or "contact"), folder, drawn)
    say_files(compared.outputs)


def compare_scene(scene: "Scene", predictor: "PhysicsPredictor", out: Path, animation: Animation | None) -> Compared:
    """Predict and simulate, write both tracks and what shows them, if that can be drawn, and print what is assumed, off
    and doubtful."""
    from pushgraph.plausibility import assumptions, remarks, simplifications
    from pushgraph.simulation.planar import simulate

    warn(assumptions(scene) + simplifications(scene, predictor.solves))
    known = scene.with_nominal_values()
    with console.status("Predicting"):
        predicted = predictor.predict(known, spread=predictor.states_spread)
    with console.status("Simulating"):
        simulated = simulate(known)
    tracks = {"Predicted": predicted, "Simulated": simulated}
    outputs = [out / "predicted.h5", out / "simulated.h5"]
    for track, path in zip(tracks.values(), outputs, strict=True):
        track.save(path)
    if animation is not None:
        from pushgraph.viewer.animation import save_animation
        from pushgraph.viewer.picture import save_comparison

        outputs += draw(out, animation, partial(save_comparison, tracks), partial(save_animation, tracks))
    console.print(differences(predicted, simulated))
    warn([f"{title}: {said}" for title, track in tracks.items() for said in remarks(track)])
    return Compared(predicted, simulated, outputs)


def demo(
    scene: Annotated[str, typer.Argument(help="demo, on a table; lever-up, in space.")] = "demo",
    out: ResultFolder = None,
) -> None:
    """Compare a shipped scene, predicted and simulated; on a table also watch it, and predict what is believed.

    Writes tables, pictures and an animation.

    Examples:

    `pushgraph demo --out demo`

    `pushgraph demo lever-up`
    """
    shown = shipped_scenes()
    if scene not in shown:
        raise typer.BadParameter(f"{scene!r}; valid: {', '.join(shown)}", param_hint="SCENE")
    in_space = lever_scene(scene_path(scene))
    if in_space is not None:
        compare_lever_scene(in_space, "lever_up", out or Path(scene), Animation.GIF)
    else:
        _demo_on_table(load_scene(scene), out or Path(scene))


def _demo_on_table(scene: "Scene", out: Path) -> None:
    from pushgraph.physics import PhysicsPredictor
    from pushgraph.regulator import BeliefRegulator
    from pushgraph.viewer.beliefs import save_believed_predictions

    predictor = PhysicsPredictor.load()
    compared = compare_scene(scene, predictor, out, Animation.GIF)
    with console.status("Watching"):
        regulator = BeliefRegulator(scene, weigh=True)
        believed = _predicted_while_watching(regulator, predictor, compared.simulated)
    with console.status("Drawing"):
        save_believed_predictions(compared.simulated, believed, regulator.pairs, out / "beliefs.png")
    after = f"after {regulator.frames} frames"
    console.print(joints_table(f"Believed {after}", regulator.pairs, regulator.probabilities))
    console.print(masses_table(f"Masses believed {after}", regulator.masses(), scene, sensor=False))
    say_files([*compared.outputs, out / "beliefs.png"])


def _predicted_while_watching(
    regulator: "BeliefRegulator", predictor: "PhysicsPredictor", track: "Track"
) -> dict[str, "Moment"]:
    """Predictions of the whole track from its start with what is believed before contact, midway and at the end."""
    from pushgraph.belief_history import joined_as
    from pushgraph.mass_history import with_masses
    from pushgraph.viewer.beliefs import Moment

    frames = len(track.times)
    moments = {0: "Believed before contact", frames // 2: f"After {frames // 2} frames", frames - 1: "At the end"}
    found = {}
    for frame, (poses, down) in enumerate(track.frames()):
        probabilities = regulator.observe(poses, down)
        if frame in moments:
            masses = regulator.masses()
            scene = with_masses(joined_as(regulator.scene(), track.scene), masses)
            found[moments[frame]] = Moment(predictor.predict_many([scene])[0], probabilities, masses)
    return found


def differences(predicted: "Track", simulated: "Track") -> Table:
    """How far the bodies went, how far off their ends were predicted, and how far off they may be."""
    table = Table(title=f"Predicted against simulated, after {simulated.times[-1]:.2f} s")
    columns: Sequence[str] = ("body", "moved (cm)", "turned (deg)", "position off (cm)", "yaw off (deg)")
    if predicted.spread is not None:
        columns = (*columns, *SPREAD_COLUMNS)
        table.caption = SPREAD_CAPTION
    for name in columns:
        table.add_column(name, justify="left" if name == "body" else "right")
    change = simulated.poses[-1] - simulated.poses[0]
    off, stated = predicted.poses[-1] - simulated.poses[-1], stated_at_the_end(predicted)
    for node, name in enumerate(simulated.nodes[1:], start=1):
        lengths = [f"{np.hypot(*values[node, :2]) * 100:.1f}" for values in (change, off)]
        angles = [f"{np.degrees(values[node, 2]):.1f}" for values in (change, off)]
        table.add_row(name, lengths[0], angles[0], lengths[1], angles[1], *stated[node - 1])
    return table
