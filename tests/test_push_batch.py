"""Many pushes side by side, and what is said of arrays that do not fit."""

import warnings

import numpy as np
import pytest
import torch
from predictors import no_correction as predictor

import pushgraph as pg
from pushgraph.errors import AssumptionWarning, PredictionError

BOX = pg.Body(name="box", shape=pg.Cuboid(size=(0.16, 0.08)), pose_world_from_body=(0.0, 0.0, 0.0), mass=0.8)
CAN = pg.Body(name="can", shape=pg.Cylinder(diameter=0.08), pose_world_from_body=(0.2, 0.1, 0.0), mass=0.3)
SCENE = pg.Scene(bodies=(BOX, CAN), tool=pg.Tool.round(0.05))
ENDS = np.array([[[-0.2, 0.0], [0.0, 0.0]], [[0.3, 0.1], [0.15, 0.1]], [[0.0, -0.2], [0.0, 0.0]]])


def test_pushes_side_by_side_end_as_each_by_itself() -> None:
    model = predictor()
    many = model.predict_pushes(SCENE, ENDS, speed=0.1)
    assert (len(many), many.names, many.refused) == (3, ("box", "can"), {})
    assert many.poses.shape == (3, 2, 3)
    for index, (start, end) in enumerate(ENDS.tolist()):
        push = pg.Push(start=tuple(start), end=tuple(end), speed=0.1)
        assert many.pushes[index].waypoints.tolist() == push.waypoints.tolist()
        alone = model.predict(SCENE, [push])
        np.testing.assert_allclose(many.tracks[index].poses, alone.poses, atol=1e-9)
        np.testing.assert_array_equal(many.poses[index], many.tracks[index].poses[-1, 1:])
    np.testing.assert_array_equal(many["can"], many.poses[:, 1])
    # A push along x moves the box alone, one against it the can alone.
    assert many["box"][0, 0] > 0.05
    assert many["can"][0].tolist() == [0.2, 0.1, 0.0]
    assert many["can"][1, 0] < 0.16
    with pytest.raises(PredictionError, match="no body 'lid'; valid: box, can"):
        many["lid"]
    again = model.predict_pushes(SCENE, list(many.pushes))
    np.testing.assert_array_equal(again.poses, many.poses)


def test_way_points_and_turns_of_arrays_are_those_of_pushes() -> None:
    turning = np.array([[[-0.3, 0.0, 0.5], [-0.2, 0.0, 1.0]]])
    assert predictor().predict_pushes(SCENE, turning).pushes[0].waypoints.tolist() == turning[0].tolist()
    bent = np.array([[[-0.3, 0.0], [-0.2, 0.0], [-0.2, 0.1]]], dtype=np.float32)
    (push,) = predictor().predict_pushes(SCENE, bent).pushes
    np.testing.assert_allclose(push.waypoints[:, :2], bent[0], atol=1e-7)
    assert len(predictor().predict_pushes(SCENE, [])) == 0


def test_a_push_that_comes_down_on_a_body_is_refused_and_the_others_predicted() -> None:
    many = predictor().predict_pushes(SCENE, np.concatenate((ENDS, [[[0.0, 0.01], [0.1, 0.0]]])))
    assert list(many.refused) == [3]
    assert "pushes[3].start: the tool would come down on body 'box'" in many.refused[3]
    assert np.isnan(many.poses[3]).all()
    assert many.tracks[3] is None
    assert np.isfinite(many.poses[:3]).all()


@pytest.mark.parametrize(
    ("pushes", "says"),
    [
        (np.zeros((3, 4)), r"pushes: shape must be \(pushes, points, 2\) or \(pushes, points, 3\).*got \(3, 4\)"),
        (np.zeros((3, 1, 2)), r"got \(3, 1, 2\)"),
        (np.array([[["a", "b"]]]), "pushes: dtype must be a real number's, got <U1"),
        (np.full((1, 2, 2), np.nan), r"pushes\[0\]: must be finite"),
        (np.array([[[0.3, 0], [0.3, 0.1]], [[0.3, 0], [9.0, 0]]]), r"pushes\[1\]: .*at most 5 m from start, got 8.7 m"),
    ],
)
def test_what_are_no_pushes_is_said(pushes, says) -> None:
    with pytest.raises(PredictionError, match=says):
        predictor().predict_pushes(SCENE, pushes)


TOOL, DOWN = np.zeros((2, 5, 3)) + [-0.3, 0.0, 0.0], np.ones((2, 5), dtype=bool)


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"tool": TOOL[..., :2]}, r"tool: shape must be \(2, frames, 3\), got \(2, 5, 2\)"),
        ({"tool": TOOL[:1]}, r"tool: shape must be \(2, frames, 3\), got \(1, 5, 3\)"),
        ({"tool": TOOL.astype(int)}, "tool: dtype must be floating point, got int64"),
        ({"tool": TOOL * np.nan}, r"tool: must hold no NaN; there is one at \(0, 0, 0\)"),
        ({"tool": TOOL[:, :0], "down": DOWN[:, :0]}, "tool: needs one frame at least"),
        ({"down": DOWN[:, :4]}, r"down: shape must be \(2, 5\), got \(2, 4\)"),
        ({"down": DOWN.astype(float)}, "down: dtype must be bool, got float64"),
        ({"down": torch.ones(2, 5)}, "down: dtype must be bool, got float32"),
        ({"force_limit": np.ones(5)}, r"force_limit: shape must be \(2, 5\), got \(5,\)"),
    ],
)
def test_rollouts_say_which_array_does_not_fit(changed, says) -> None:
    model = predictor()
    arrays = {"tool": TOOL, "down": DOWN} | changed
    with pytest.raises(PredictionError, match=says):
        model.rollout(model.start([SCENE, SCENE]), **arrays)


def test_rollouts_take_numpy_and_answer_in_it() -> None:
    model = predictor()
    states = model.start([SCENE, SCENE])
    tool = np.stack([np.linspace([-0.15, 0.0, 0.0], [0.0, y, 0.0], 20) for y in (0.0, 0.02)])
    down = np.ones((2, 20), dtype=bool)
    poses, taken = model.rollout(states, tool, down).numpy()
    same = model.rollout(states, torch.from_numpy(tool), torch.from_numpy(down))
    np.testing.assert_array_equal(poses, same.poses.numpy())
    np.testing.assert_array_equal(taken, tool)


def test_assumed_masses_and_frictions_are_said() -> None:
    unknown = SCENE.replace(bodies=(BOX.replace(mass=None), CAN), side_friction=None)
    push = pg.Push(start=(-0.3, 0.0), end=(-0.2, 0.0))
    with pytest.warns(AssumptionWarning, match=r"mass of 'box' is unknown: taken as 0\.6 kg.*side_friction is unknown"):
        predictor().predict(unknown, [push])
    with pytest.warns(AssumptionWarning, match="mass of 'box' is unknown"):
        predictor().predict_pushes(unknown, [push])
    with warnings.catch_warnings():
        warnings.simplefilter("error", AssumptionWarning)
        predictor().predict(SCENE, [push])
