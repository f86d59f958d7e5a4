"""The commands about one scene: predict, simulate."""

from collections.abc import Sequence
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer
from rich.table import Table

from pushgraph.cli.choices import Animation, Masses, Relations, Robot
from pushgraph.cli.drawing import draw, drawable
from pushgraph.cli.lever import lever_scene, predict_lever_scene, simulate_lever_scene
from pushgraph.cli.output import console, say_files, warn
from pushgraph.errors import SceneError

if TYPE_CHECKING:
    from pushgraph.scene import Scene
    from pushgraph.track import Track

SPREAD_COLUMNS = ("± (cm)", "± (deg)")
SPREAD_CAPTION = "±: longer half-axis of the ellipse that holds the true place with 68 %, half the interval of the yaw"
SceneName = Annotated[str, typer.Argument(help="A scene file (JSON), or the name of a shipped scene: demo, lever-up.")]
ResultFolder = Annotated[Path | None, typer.Option(help="Folder for the results.", show_default="the scene's name")]
SHIPPED_SCENES = Path(str(files("pushgraph"))) / "scenes"


def predict(
    scene: SceneName,
    out: ResultFolder = None,
    relations: Annotated[
        Relations, typer.Option(help="none: as if nothing were joined; believed: those of --beliefs.")
    ] = Relations.GIVEN,
    masses: Annotated[
        Masses, typer.Option(help="mean: as if no mass were known; believed: the medians of --beliefs.")
    ] = Masses.GIVEN,
    beliefs: Annotated[Path | None, typer.Option(help="What pushgraph observe wrote (JSON).")] = None,
    model: Annotated[
        str | None,
        typer.Option(
            help="contact, propnet, image, or a checkpoint; of scenes in space lever_up or a checkpoint.",
            show_default="contact, lever_up",
        ),
    ] = None,
    adaptation: Annotated[
        Path | None, typer.Option(help="What pushgraph adapt wrote: of bodies that bear the names of its shapes.")
    ] = None,
    surface: Annotated[
        str | None, typer.Option(help="With --adaptation: the table's, as named there.", show_default="the only one")
    ] = None,
    animation: Annotated[Animation, typer.Option(help="mp4 needs ffmpeg.")] = Animation.GIF,
) -> None:
    """Predict a scene's pushes with a learned network: track (HDF5, CSV), picture, animation, table of final poses.

    How far off each body may be is stated, too: with `--relations believed`, as far as these are doubtful.

    Examples:

    `pushgraph predict scene.json --out result`

    `pushgraph predict demo --relations none --masses mean --animation none`

    `pushgraph predict scene.json --relations believed --masses believed --beliefs observed/beliefs.json`

    `pushgraph predict lever-up`
    """
    from pushgraph.belief_history import BeliefHistory
    from pushgraph.physics import PhysicsPredictor
    from pushgraph.plausibility import assumptions, simplifications

    for option, value in (("relations", relations), ("masses", masses)):
        if value == "believed" and beliefs is None:
            raise typer.BadParameter("needs --beliefs", param_hint=f"--{option} believed")
    if beliefs is not None and "believed" not in (relations, masses):
        raise typer.BadParameter("needs --relations believed or --masses believed", param_hint="--beliefs")
    drawn = drawable(animation)
    folder = out or Path(Path(scene).stem)
    in_space = lever_scene(scene_path(scene))
    if in_space is not None:
        for option, value in (("relations", relations), ("masses", masses)):
            if value != "given":
                raise typer.BadParameter("scenes in space know no other than given", param_hint=f"--{option} {value}")
        predict_lever_scene(in_space, model or "lever_up", folder, drawn)
        return
    given = load_scene(scene)
    if relations == "none":
        given = given.replace(joints=(), unknown_pairs=())
    probabilities = None
    if beliefs is not None:
        history = BeliefHistory.load(beliefs)
        if relations == "believed":
            given = history.apply_to(given)
            probabilities = dict(zip(history.pairs, history.probabilities[-1], strict=True))
        if masses == "believed":
            given = history.apply_masses(given)
    if masses == "mean":
        given = given.replace(bodies=tuple(body.replace(mass=None) for body in given.bodies))
    predictor = PhysicsPredictor.load(model or "contact")
    if adaptation is not None:
        from pushgraph.adaptation.files import load_adaptation

        given = load_adaptation(adaptation, predictor.hash).apply_to(given, surface)
    warn(assumptions(given) + simplifications(given, predictor.solves))
    with console.status(f"Predicting {len(given.pushes)} pushes"):
        spread = predictor.states_spread
        track = predictor.predict(given, spread=spread, beliefs=probabilities if spread else None)
    _write_track(track, folder, drawn)


def simulate(
    scene: SceneName,
    out: ResultFolder = None,
    robot: Annotated[
        Robot, typer.Option(help="kinematic: the tool goes exactly as told; ur10: an arm holds it (extra [arm]).")
    ] = Robot.KINEMATIC,
    render: Annotated[
        Path | None, typer.Option(help="Also show the arm at work: a .gif, or an .mp4 (needs ffmpeg).")
    ] = None,
    animation: Annotated[Animation, typer.Option(help="mp4 needs ffmpeg.")] = Animation.GIF,
) -> None:
    """Simulate a scene's pushes in MuJoCo: track (HDF5, CSV), picture, animation, table of final poses.

    Of a scene in space, in which a board is levered up, the track is HDF5.
    With `--robot ur10` also what the arm's joints were told, with the fields of ROS's JointTrajectory.

    Examples:

    `pushgraph simulate scene.json --out result`

    `pushgraph simulate demo --animation none`

    `pushgraph simulate demo --robot ur10 --render arm.gif`

    `pushgraph simulate lever-up`
    """
    drawn = drawable(animation)
    if render is not None and robot != "ur10":
        raise typer.BadParameter("needs --robot ur10", param_hint="--render")
    folder = out or Path(Path(scene).stem)
    in_space = lever_scene(scene_path(scene))
    if in_space is not None and robot != "kinematic":
        raise typer.BadParameter("moves tools on a table, not in space", param_hint=f"--robot {robot}")
    if in_space is not None:
        simulate_lever_scene(in_space, folder, drawn)
    elif robot == "ur10":
        _simulate_with_arm(scene, folder, drawn, render)
    else:
        _simulate(scene, folder, drawn)


def _simulate(source: str, out: Path, animation: Animation | None) -> None:
    from pushgraph.simulation.planar import simulate

    known = _with_nominal_values(source)
    with console.status(f"Simulating {len(known.pushes)} pushes"):
        track = simulate(known)
    _write_track(track, out, animation)


def _simulate_with_arm(source: str, out: Path, animation: Animation | None, render: Path | None) -> None:
    from pushgraph.simulation.arm import simulate_with_arm
    from pushgraph.viewer.animation import check_animation
    from pushgraph.viewer.arm_animation import save_arm_animation

    if render is not None:
        check_animation(render)
    known = _with_nominal_values(source)
    with console.status(f"Planning and simulating {len(known.pushes)} pushes by the arm"):
        execution = simulate_with_arm(known)
    outputs = [out / "joint_trajectory.json"]
    execution.trajectory.save(outputs[0])
    if render is not None:
        outputs.append(render)
        with console.status("Drawing the arm"):
            save_arm_animation(execution, render)
    _write_track(execution.track, out, animation, outputs)


def _with_nominal_values(source: str) -> "Scene":
    from pushgraph.plausibility import assumptions

    scene = load_scene(source)
    warn(assumptions(scene))
    return scene.with_nominal_values()


def _write_track(track: "Track", out: Path, animation: Animation | None, written: Sequence[Path] = ()) -> None:
    """Write a track and what shows it, if that can be drawn; `written`: what has been already."""
    from pushgraph.plausibility import remarks

    outputs = [out / "track.h5", out / "track.csv"]
    for path in outputs:
        track.save(path)
    if animation is not None:
        from pushgraph.viewer.animation import save_animation
        from pushgraph.viewer.picture import save_picture

        outputs += draw(out, animation, partial(save_picture, track), partial(save_animation, track))
    console.print(final_poses(track))
    warn(remarks(track))
    say_files([*outputs, *written])


def shipped_scenes() -> list[str]:
    """Names of the scenes that come with pushgraph."""
    return sorted(path.stem for path in SHIPPED_SCENES.glob("*.json"))


def scene_path(source: str) -> Path:
    """The file itself, or a shipped one by name."""
    shipped = SHIPPED_SCENES / f"{source}.json"
    return shipped if shipped in SHIPPED_SCENES.glob("*.json") and not Path(source).is_file() else Path(source)


def load_scene(source: str) -> "Scene":
    """The scene in a file, or a shipped one by name."""
    from pushgraph.scene import Scene

    try:
        return Scene.load(scene_path(source))
    except SceneError as error:
        if isinstance(error.__cause__, FileNotFoundError):
            raise SceneError(f"{error}; shipped scenes: {', '.join(shipped_scenes())}") from None
        raise


def final_poses(track: "Track") -> Table:
    """Where everything ended, and how far off that may be, if the track states it."""
    table = Table(title=f"Final poses after {len(track.scene.pushes)} pushes, {track.times[-1]:.2f} s")
    columns = ["body", "x (m)", "y (m)", "yaw (deg)", "moved (cm)", "turned (deg)"]
    stated = stated_at_the_end(track)
    if track.spread is not None:
        columns += SPREAD_COLUMNS
        table.caption = SPREAD_CAPTION
    for name in columns:
        table.add_column(name, justify="left" if name == "body" else "right")
    change = track.poses[-1] - track.poses[0]
    for node, name in enumerate(track.nodes[1:], start=1):
        x, y, yaw = track.poses[-1, node]
        moved, turned = np.hypot(*change[node, :2]) * 100, np.degrees(change[node, 2])
        cells = (f"{x:.4f}", f"{y:.4f}", f"{np.degrees(yaw):.1f}", f"{moved:.1f}", f"{turned:.1f}")
        table.add_row(name, *cells, *stated[node - 1])
    return table


def stated_at_the_end(track: "Track") -> list[list[str]]:
    """For every body the longer half-axis of its 68 % ellipse and half its 68 % interval; nothing if none is stated."""
    if track.spread is None:
        return [[] for _ in track.scene.bodies]
    final = track.spread.take(-1)
    ellipse, turn = final.ellipse(0.68), np.degrees(final.yaw_interval(0.68))
    longest = 100 * np.maximum(ellipse.along, ellipse.across)
    return [[f"{a:.2f}", f"{b:.1f}"] for a, b in zip(longest, turn, strict=True)]
