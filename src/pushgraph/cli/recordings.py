"""The commands about recordings: observe, track."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Group
from rich.live import Live
from rich.table import Table

from pushgraph.cli.beliefs import joints_table, masses_table, places_table
from pushgraph.cli.choices import Animation, KnownMasses, KnownRelations, Up
from pushgraph.cli.drawing import drawable
from pushgraph.cli.output import console
from pushgraph.cli.scenes import load_scene
from pushgraph.errors import TrackError
from pushgraph.storage import replacing

if TYPE_CHECKING:
    from pushgraph.recording.sightings import Declared
    from pushgraph.recording.summary import NodeSummary
    from pushgraph.regulator import BeliefRegulator

FRAMES_PER_REFRESH = 10
"""Of the live table."""
MOST_STRETCHES = 4
"""A node that was lost is printed with so many stretches at most."""

_Names = Annotated[
    list[str] | None, typer.Option("--name", help="RECORDED=NODE: whose pose a name is, such as Take:RB1=cup; again.")
]
_Units = Annotated[str | None, typer.Option(help="Of the file, such as 'mm deg ms'; a header may say them, too.")]
_Axes = Annotated[
    str | None, typer.Option(help="The file's axes that are the world's x and y: x,-y or -y,x; mirrored, swapped.")
]
_Frame = Annotated[str | None, typer.Option(help="'x y yaw' of the file's origin in the world, in its own units.")]
_Up = Annotated[Up | None, typer.Option(help="Axis of spatial poses that points off the table.")]
_Lag = Annotated[
    float | None, typer.Option(help="Seconds by which the robot's clock is behind.", show_default="estimated")
]
_Mend = Annotated[bool, typer.Option("--mend", help="Set right what can be, such as tags read turned.")]
_Episode = Annotated[int | None, typer.Option(help="Of a LeRobot data set.")]


def observe(
    scene: Annotated[str, typer.Argument(help="A scene file (JSON), or the name of a shipped scene: demo.")],
    track: Annotated[Path, typer.Argument(help="What was seen: CSV, HDF5, Motive, ROS bag, MCAP, LeRobot parquet.")],
    out: Annotated[Path, typer.Option(help="Folder for the results.")] = Path("observed"),
    relations: Annotated[
        KnownRelations, typer.Option(help="none: nothing is known of joints; given: what the scene says of them holds.")
    ] = KnownRelations.NONE,
    masses: Annotated[
        KnownMasses, typer.Option(help="given: those that the scene leaves out are learnt; unknown: all are.")
    ] = KnownMasses.GIVEN,
    prior: Annotated[
        str | None,
        typer.Option(
            help="How likely joints of neighbours are beforehand, such as 'none=2 fixed=1'; those not named cannot be.",
            show_default="as in the training data",
        ),
    ] = None,
    camera_error: Annotated[
        float | None,
        typer.Option(
            help="How far poses may be off beside noise, which is found by itself (m): 0.0005 for a lens that bends.",
            show_default="1.5 times the noise, up to 0.0003",
        ),
    ] = None,
    model: Annotated[str, typer.Option(help="belief, paper_recipe, or a checkpoint.")] = "belief",
    physics: Annotated[
        Path | None, typer.Option(help="Checkpoint that the belief stands on.", show_default="the shipped one")
    ] = None,
    name: _Names = None,
    units: _Units = None,
    axes: _Axes = None,
    frame: _Frame = None,
    up: _Up = None,
    lag: _Lag = None,
    mend: _Mend = False,
    episode: _Episode = None,
) -> None:
    """Watch a track and learn what is joined to what, and what weighs how much: live tables, beliefs over time (JSON,
    picture), the scene.

    What is doubtful about the track is printed; what cannot be believed is refused. The scene is written as it was in
    the end, with the likeliest joints and the medians of learnt masses, ready for pushes and prediction.

    Examples:

    `pushgraph observe scene.json track.csv --out observed`

    `pushgraph observe scene.json take.csv --units "mm deg" --axes mirrored --name Take:RB1=cup`

    `pushgraph observe scene.json track.csv --masses unknown`

    `pushgraph observe scene.json track.csv --prior "none=1 fixed=1"`

    `pushgraph predict scene.json --relations believed --masses believed --beliefs observed/beliefs.json`
    """
    from pushgraph.belief import BeliefModel
    from pushgraph.belief_history import BeliefHistory
    from pushgraph.recording.recording import read_recording
    from pushgraph.recording.sightings import ReadOptions

    loaded = load_scene(scene)
    recording = read_recording(
        track,
        loaded,
        names=_pairs(name),
        declared=_declared(units, axes, frame),
        options=ReadOptions(up, episode),
        lag=lag,
        mend=mend,
    )
    _print_findings(finding for finding in recording.findings if not finding.grave)
    seen = recording.believed()
    sensor = seen.wrench is not None
    with Live(console=console, auto_refresh=False, transient=True) as live:

        def show(frame: int, regulator: "BeliefRegulator") -> None:
            if frame % FRAMES_PER_REFRESH == 0:
                after = f"after {regulator.frames} frames"
                tables = [joints_table(f"Likeliest joints {after}", regulator.pairs, regulator.probabilities)]
                if weighed := regulator.masses():
                    tables.append(masses_table(f"Masses {after}", weighed, loaded, sensor))
                live.update(Group(*tables), refresh=True)

        watching = BeliefModel.load(model, physics=physics)
        if prior is not None:
            watching = watching.expecting(prior_of(prior))
        if camera_error is not None:
            watching = watching.seen_by(camera_error)
        history = BeliefHistory.watch(loaded, seen, watching, relations == "given", masses == "unknown", show)
    outputs = [out / "beliefs.json", out / "scene.json"]
    history.save(outputs[0])
    with replacing(outputs[1]) as temporary:
        temporary.write_text(history.scene.to_json(), encoding="utf-8")
    if drawable(Animation.NONE) is not None:
        from pushgraph.viewer.beliefs import save_beliefs

        outputs.append(out / "beliefs.png")
        save_beliefs(history, outputs[-1])
    after = f"after {len(history.times)} frames, {history.times[-1] - history.times[0]:.2f} s"
    console.print(joints_table(f"Likeliest joints {after}", history.pairs, history.probabilities[-1]))
    if history.joints:
        console.print(places_table(history.joints))
    if history.masses:
        console.print(masses_table(f"Masses {after}", history.masses, loaded, sensor))
    elif masses == "unknown":
        console.print(f"No mass was learnt: {model} says nothing of masses, or nothing can move.", markup=False)
    for lost, stretches in history.lost.items():
        unseen = ", ".join(f"{first:.2f} to {last:.2f} s" for first, last in stretches[:MOST_STRETCHES])
        more = f" and {len(stretches) - MOST_STRETCHES} times more" if len(stretches) > MOST_STRETCHES else ""
        console.print(f"{lost} was not seen from {unseen}{more}.", markup=False)
    console.print("Written: " + ", ".join(str(path) for path in outputs), soft_wrap=True, markup=False)


def track(
    file: Annotated[Path, typer.Argument(help="CSV, HDF5, Motive CSV, ROS bag, MCAP, or LeRobot parquet.")],
    out: Annotated[Path | None, typer.Option(help="The track to write: .h5 or .csv.", show_default="none")] = None,
    scene: Annotated[
        str | None, typer.Option(help="The scene that was recorded.", show_default="the file's own, if it holds one")
    ] = None,
    name: _Names = None,
    units: _Units = None,
    axes: _Axes = None,
    frame: _Frame = None,
    up: _Up = None,
    lag: _Lag = None,
    mend: _Mend = False,
    episode: _Episode = None,
) -> None:
    """Read a recording, say what is in it and what is doubtful, and convert it.

    Without a scene nothing is known of shapes: names, rates, gaps, jumps and doubtful units are told, and all sightings
    are written, in m, rad and s. Exit status 1 if it cannot be believed; nothing is written then.

    Examples:

    `pushgraph track take.csv --out track.h5`

    `pushgraph track push.bag --scene scene.json --name /vicon/block_1=block --out track.h5`
    """
    from pushgraph.recording.convention import Convention
    from pushgraph.recording.files import read_sightings, save_sightings
    from pushgraph.recording.recording import recording_of
    from pushgraph.recording.sightings import ReadOptions
    from pushgraph.recording.summary import doubts, summarize
    from pushgraph.scene import Scene

    declared, names = _declared(units, axes, frame), _pairs(name)
    sightings = read_sightings(file, ReadOptions(up, episode))
    world = Convention.of(sightings.declared.overruled_by(declared)).apply(sightings)
    console.print(_summary_table(file, summarize(world)))
    if scene is None and not sightings.scene:
        _print_findings([*sightings.remarks, *doubts(world)])
        console.print("No --scene: whose poses these are, and whether they can be, was not checked.")
        if out is not None:
            save_sightings(world, out)
    else:
        try:
            recorded = load_scene(scene) if scene else Scene.from_json(sightings.scene, f"{file}: scene")
            recording = recording_of(sightings, recorded, names, declared, lag, mend, str(file))
        except TrackError as error:
            raise TrackError(f"{file}: {error}") from None
        _print_findings(finding for finding in recording.findings if not finding.grave)
        believed = recording.believed()
        frames = believed.at_frames()
        console.print(f"{len(believed.times)} frames at {recording.rate:.3g} Hz, {len(frames.times)} of 0.05 s.")
        if out is not None:
            believed.save(out)
    if out is not None:
        console.print(f"Written: {out}", soft_wrap=True, markup=False)


def prior_of(text: str) -> dict[str, float]:
    """The prior that `none=2 fixed=1` names."""
    shares = {}
    for word in text.replace(",", " ").split():
        kind, _, number = word.partition("=")
        try:
            shares[kind] = float(number)
        except ValueError:
            raise typer.BadParameter(f"{word!r}; valid: JOINT=NUMBER, such as fixed=1", param_hint="--prior") from None
    return shares


def _pairs(names: Sequence[str] | None) -> dict[str, str]:
    pairs = {}
    for pair in names or ():
        recorded, sign, node = pair.rpartition("=")
        if not sign or not recorded or not node:
            raise typer.BadParameter(f"{pair!r}; valid: RECORDED=NODE, such as Take:RB1=cup", param_hint="--name")
        pairs[recorded] = node
    return pairs


def _declared(units: str | None, axes: str | None, frame: str | None) -> "Declared":
    from pushgraph.recording.convention import declared_units
    from pushgraph.recording.sightings import Declared

    said = Declared() if units is None else declared_units(units, "--units")
    return said._replace(axes=axes, frame=frame)


def _print_findings(findings: Iterable[object]) -> None:
    for finding in findings:
        console.print(f"Note: {finding}", style="yellow", soft_wrap=True, markup=False, highlight=False)


def _summary_table(file: Path, summaries: Iterable["NodeSummary"]) -> Table:
    table = Table(title=f"Seen in {file.name}")
    for column in ("name", "sightings", "lost", "Hz", "from (s)", "to (s)", "gaps", "longest", "jumps"):
        table.add_column(column, justify="left" if column == "name" else "right")
    for one in summaries:
        ends = f"{one.first:.2f}", f"{one.last:.2f}"
        counts = f"{one.gaps}", f"{one.longest_gap:.2f}", f"{one.jumps}"
        table.add_row(one.name, f"{one.sightings}", f"{one.lost}", f"{one.rate:.3g}", *ends, *counts)
    return table
