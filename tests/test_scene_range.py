"""What a predictor says about scenes unlike those it was checked on."""

import warnings

import pytest
from scenes import body, workshop

from pushgraph.errors import RangeWarning
from pushgraph.network.dynamics import ContactDynamics
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
