"""Pages of the viewer beside the report: what was predicted, and what happened as ghosts."""

from pathlib import Path

from pushgraph.lever_physics import LeverPredictor
from pushgraph.lever_scene import LeverScene
from pushgraph.physics import PhysicsPredictor
from pushgraph.scene import Scene
from pushgraph.simulation.lever import simulate_lever
from pushgraph.simulation.planar import simulate

SCENES = Path(__file__).parents[1] / "scenes"


def save_replays(folder: Path) -> dict[str, Path]:
    """Write a page for each shipped scene; returns what they show, and where they are.

    Raises MissingExtraError if viser is not installed.
    """
    from pushgraph.view import check_installed

    check_installed()
    from pushgraph.view.saved_page import save_page

    folder.mkdir(parents=True, exist_ok=True)
    scene, drive = Scene.load(SCENES / "demo.json"), LeverScene.load(SCENES / "lever-up.json")
    pages = {
        "Six jointed bodies and four pushes": folder / "demo.html",
        "A board levered up out of a drive": folder / "lever-up.html",
    }
    planar, space = pages.values()
    save_page(planar, PhysicsPredictor.load().predict(scene), compare=simulate(scene), title="pushgraph: demo")
    save_page(space, LeverPredictor.load().predict(drive), compare=simulate_lever(drive), title="pushgraph: lever-up")
    return pages
