"""The command plan."""

from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.table import Table

from pushgraph.cli.output import check_choice, console
from pushgraph.cli.scenes import check_animation_option, load_scene, warn


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
    dynamics: Annotated[str, typer.Option(help="learned, or mujoco.")] = "learned",
    execute: Annotated[bool, typer.Option("--execute", help="Simulate the plan, too.")] = False,
    out: Annotated[Path, typer.Option(help="Folder for the results.")] = Path("plan"),
    animation: Annotated[str, typer.Option(help="gif, mp4 (needs ffmpeg) or none.")] = "gif",
) -> None:
    """Choose the tool and the pushes that bring a body where it shall be; say where it is expected to end, how surely.

    Examples:

    `pushgraph plan scene.json --tools all --goal cup 0.2 0.1 --execute`

    `pushgraph plan demo --goal box -0.3 0.2 45 --keep cup --out result`
    """
    from pushgraph.physics import PhysicsPredictor
    from pushgraph.planning.costs import cost_of
    from pushgraph.planning.dynamics import learned, simulated
    from pushgraph.planning.exhaustive import plan_exhaustively
    from pushgraph.planning.goal import Goal
    from pushgraph.planning.sequences import sequences
    from pushgraph.planning.tools import load_tools
    from pushgraph.plausibility import assumptions

    check_choice("dynamics", dynamics, ("learned", "mujoco"))
    check_animation_option(animation)
    given = load_scene(scene)
    body, x, y = goal
    wanted = Goal(
        body=body, position=(x, y), yaw=None if yaw is None else float(np.radians(yaw)), keep=tuple(keep or ())
    )
    warn(assumptions(given.replace(pushes=())))
