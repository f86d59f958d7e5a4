"""The command plan."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer
from rich.progress import Progress

from pushgraph.cli.choices import Animation, Arm, PlanningDynamics, Risk
from pushgraph.cli.drawing import draw, drawable
from pushgraph.cli.output import BAR, console, warn
from pushgraph.cli.scenes import final_poses, load_scene

if TYPE_CHECKING:
    from pushgraph.planning.goal import Goal
    from pushgraph.planning.plan import Plan
    from pushgraph.scene import Scene
    from pushgraph.track import Track



def plan(
    scene: Annotated[str, typer.Argument(help="A scene file (JSON), or the name of a shipped scene: demo.")],
    goal: Annotated[
        tuple[str, float, float], typer.Option(metavar="BODY X Y [YAW]", help="Which body shall be where (m, degrees).")
    ],
    yaw: Annotated[float | None, typer.Argument(help="Of the goal (degrees).", show_default="any", hidden=True)] = None,
    tools: Annotated[
        list[str] | None,
        typer.Option(help="all, a shipped tool, or a file; again.", show_default="the scene's own tool"),
    ] = None,
    keep: Annotated[list[str] | None, typer.Option(help="A body that shall stay where it is; again.")] = None,
    start: Annotated[
        tuple[float, float], typer.Option(help="With --tools: where the end-effector comes down.")
    ] = (0.0, 0.0),
    pushes: Annotated[int, typer.Option(min=1, max=4, help="At most.")] = 3,
    dynamics: Annotated[
        PlanningDynamics, typer.Option(help="What plans are tried on.")
    ] = PlanningDynamics.LEARNED,
    risk: Annotated[Risk, typer.Option(help="What of the cost is made least.")] = Risk.PREDICTED,
    robot: Annotated[
        Arm | None, typer.Option(help="ur10: only what the scene's arm reaches.", show_default="none")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of what is drawn, without --tools.")] = 0,
    execute: Annotated[bool, typer.Option("--execute", help="Simulate the plan, too.")] = False,
    out: Annotated[Path, typer.Option(help="Folder for the results.")] = Path("plan"),
    animation: Annotated[Animation, typer.Option(help="mp4 needs ffmpeg.")] = Animation.GIF,
) -> None:
    """Choose the pushes that bring a body where it shall be, and the tool; say where it is expected to end, how surely.

    With `--tools` every tool is tried with all sequences of 20 cm pushes in four directions, without lifting. Else
    straight pushes of the scene's own tool are drawn, and drawn again around the best; the tool is lifted between them.
    The pushes that the scene holds are left out. Writes plan.json, the tracks, a picture and an animation; with
    `--robot` and `--execute` also the joint trajectory.

    Examples:

    `pushgraph plan scene.json --tools all --goal cup 0.2 0.1 --execute`

    `pushgraph plan demo --goal box -0.3 0.2 45 --keep cup --out result`
    """
    from pushgraph.physics import PhysicsPredictor
    from pushgraph.planning import planner
    from pushgraph.planning.costs import Cost
    from pushgraph.planning.dynamics import learned, simulated
    from pushgraph.planning.goal import Goal
    from pushgraph.planning.reach import arm_reach
    from pushgraph.planning.risk import Score, as_predicted, expected, percentile
    from pushgraph.planning.sampling import Sampling
    from pushgraph.planning.sequences import sequences
    from pushgraph.planning.tools import load_tools
    from pushgraph.plausibility import assumptions, remarks

    drawn = drawable(animation)
    given = load_scene(scene).replace(pushes=())
    body, x, y = goal
    turned = None if yaw is None else float(np.radians(yaw))
    wanted = Goal(body=body, position=(x, y), yaw=turned, keep=tuple(keep or ()))
    wanted.check(given)
    chosen = load_tools("all" if tools == ["all"] else tools) if tools else []
    warn([said for said in assumptions(given) if "no pushes" not in said])
    predictor = PhysicsPredictor.load()
    risks: dict[Risk, Callable[[Cost], Score]] = {
        Risk.PREDICTED: as_predicted,
        Risk.EXPECTED: expected,
        Risk.PERCENTILE: percentile,
    }
    known = given.with_nominal_values()
    with Progress(*BAR, console=console) as progress:
        bar = progress.add_task("planning", total=None)
        planned = planner.plan(
            known,
            wanted,
            learned(predictor, spread=risk != "predicted") if dynamics == "learned" else simulated,
            chosen,
            sequences(start, pushes=pushes) if chosen else (),
            np.random.default_rng(seed),
            Sampling(pushes=pushes),
            risks[risk],
            arm_reach if robot else None,
            lambda done, total: progress.update(bar, completed=done, total=total),
        )
    if not planned.pushes:
        console.print("No push that was tried brings it nearer than it is.", style="yellow")
        raise typer.Exit(1)
    tracks = {"Expected": predictor.predict(planned.scene, spread=predictor.states_spread)}
    console.print(_said(planned), highlight=False, markup=False)
    outputs = [out / "plan.json", out / "expected.h5"]
    planned.save(outputs[0])
    tracks["Expected"].save(outputs[1])
    if execute:
        tracks["Executed"] = _executed(planned.scene, robot, out, outputs)
        outputs.append(out / "executed.h5")
        tracks["Executed"].save(outputs[-1])
    if drawn is not None:
        from pushgraph.viewer.animation import save_animation
        from pushgraph.viewer.plan import save_plan

        outputs += draw(out, drawn, partial(save_plan, tracks, wanted), partial(save_animation, tracks))
    for title, track in tracks.items():
        console.print(f"{title}: {_distance(wanted, track)}", highlight=False)
        console.print(final_poses(track))
        warn(remarks(track))
    console.print("Written: " + ", ".join(str(path) for path in outputs), soft_wrap=True, markup=False)


def _executed(scene: "Scene", robot: str | None, out: Path, outputs: list[Path]) -> "Track":
    """The plan simulated, with the tool moved by itself, or held by the arm."""
    from pushgraph.simulation.planar import simulate

    with console.status("Executing"):
        if robot is None:
            return simulate(scene)
        from pushgraph.simulation.arm import simulate_with_arm

        execution = simulate_with_arm(scene)
    outputs.append(out / "joint_trajectory.json")
    execution.trajectory.save(outputs[-1])
    return execution.track


def _said(planned: "Plan") -> str:
    """The tool, and each push in a line."""
    lines = [f"Tool: {planned.tool}"]
    for number, push in enumerate(planned.pushes, start=1):
        way = " to ".join(f"({x:.3f}, {y:.3f})" for x, y, _ in push.waypoints)
        seconds = "" if push.times is None else f", {push.times[-1]:.2f} s"
        lines.append(f"Push {number}: from {way}{seconds}")
    return "\n".join(lines)


def _distance(goal: "Goal", track: "Track") -> str:
    """How far the body ends from its goal."""
    error, turn = goal.error(track.poses[-1, 1 + track.scene.names.index(goal.body)])
    turned = "" if goal.yaw is None else f" and {np.degrees(turn):.1f} degrees"
    return f"{goal.body!r} ends {100 * error:.1f} cm{turned} from its goal"
