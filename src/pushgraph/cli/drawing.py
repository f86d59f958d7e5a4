"""Pictures and animations beside the tracks that commands write, where the viewer is installed."""

from collections.abc import Callable
from pathlib import Path

from pushgraph.cli.choices import Animation
from pushgraph.cli.output import console, warn
from pushgraph.errors import MissingExtraError


def drawable(animation: Animation) -> Animation | None:
    """The animation that was asked for; None, which is said, if nothing can be drawn as the viewer is not installed.

    Refuses one that cannot be made, before anything else is done.
    """
    try:
        from pushgraph.viewer.animation import check_animation
    except MissingExtraError as error:
        warn([f"nothing is drawn: {error}"])
        return None
    if animation != Animation.NONE:
        check_animation(f"animation.{animation.value}")
    return animation


def draw(
    out: Path, animation: Animation, picture: Callable[[Path], None], animated: Callable[[Path], None]
) -> list[Path]:
    """Have a picture drawn, and the animation that was asked for; returns the files."""
    outputs = [out / "picture.png"]
    with console.status("Drawing"):
        picture(outputs[0])
        if animation != Animation.NONE:
            outputs.append(out / f"animation.{animation.value}")
            animated(outputs[-1])
    return outputs
