"""What a predictor says about scenes unlike those it was checked on."""

import re
import warnings

import pytest
from scenes import body, workshop

from pushgraph.cli.scenes import SHIPPED_SCENES
from pushgraph.errors import RangeWarning
from pushgraph.lever_physics import LeverPredictor
from pushgraph.lever_scene import LeverScene
from pushgraph.network.dynamics import ContactDynamics
from pushgraph.network.lever_dynamics import LeverContact
from pushgraph.physics import PhysicsPredictor
from pushgraph.scene import Scene, Table
from pushgraph.scene_range import outside, range_of
from pushgraph.shape import Cuboid
from pushgraph.tool import Push


def test_the_range_is_that_of_all_scenes() -> None:
    other = workshop().replace(table=Table(friction=0.9))
    ranges = range_of([workshop(), other])
    assert ranges["table friction"] == [0.45, 0.9]
    assert ranges["mass"] == [0.1, 0.5]
    assert ranges["mass over the lightest"] == [1.0, 5.0]
    assert ranges["length"] == pytest.approx([0.08, 0.14])
    assert ranges["width"] == pytest.approx([0.02, 0.12])
    assert ranges["bodies"] == [4, 4]
    assert not outside(workshop(), ranges)


def test_what_lies_outside_is_named_with_its_field_and_the_range() -> None:
    ranges = range_of([workshop()])
    heavy = body("anvil", 0.0, 0.0, mass=80.0)
    thin = body("foil", 0.3, 0.0, Cuboid(size=(0.1, 0.004)), mass=0.5)
    push = Push(start=(-0.2, 0), end=(0, 0), speed=0.9)
    scene = Scene(bodies=(heavy, thin), table=Table(friction=1.2), pushes=(push,))
    said = "\n".join(outside(scene, ranges))
    assert "mass of body 'anvil': 80 kg is outside of 0.1 to 0.5 kg" in said
    assert "table.friction: 1.2 is outside of 0.45 to 0.45" in said
    assert "shape of body 'foil': 0.004 m is outside of 0.02 to 0.12 m" in said
    assert "more" in said


def test_boards_in_space_have_ranges_of_their_own() -> None:
    scene = LeverScene.load(SHIPPED_SCENES / "lever-up.json")
    ranges = range_of([scene])
    board, thinnest = scene.bodies[scene.board], min(min(box.size) for box in scene.tool.boxes)
    assert ranges["mass"] == [board.mass, board.mass]
    assert [ranges[name][0] for name in ("length", "width", "thickness")] == sorted(board.size, reverse=True)
    assert ranges["tool size"][0] == thinnest
    assert ranges["bodies"] == [len(scene.bodies)] * 2
    assert not outside(scene, ranges)
    bodies = (*scene.bodies[: scene.board], board.replace(mass=2.0), *scene.bodies[scene.board + 1 :])
    odd = scene.replace(bodies=bodies, path=(scene.path[0], scene.path[1].replace(time=0.1), *scene.path[2:]))
    said = outside(odd, ranges)
    assert f"mass of body 'board': 2 kg is outside of {board.mass:.3g} to {board.mass:.3g} kg" in said
    assert any(re.match(r"speed to path\[1\]: .* m/s is outside of 0 to ", sentence) for sentence in said)
    predictor = LeverPredictor(LeverContact().eval(), {"range": ranges})
    short = odd.replace(path=odd.path[:1])
    with pytest.warns(RangeWarning, match="mass of body 'board': 2 kg is outside"):
        predictor.predict(short)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        predictor.predict(short)


def test_a_predictor_warns_once() -> None:
    record = {"range": range_of([workshop()])}
    predictor = PhysicsPredictor(ContactDynamics().eval().requires_grad_(False), record)
    odd = workshop().replace(side_friction=0.9)
    with pytest.warns(RangeWarning, match="side_friction: 0.9 is outside of 0.25 to 0.25"):
        predictor.predict(odd)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        predictor.predict(odd)
        predictor.predict(workshop())
