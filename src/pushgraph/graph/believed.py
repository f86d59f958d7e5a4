"""From what is believed of unknown pairs to relations that a prediction can use, and where their joints sit."""

from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from pushgraph import pose
from pushgraph.contact import RoundedBox, signed_gap
from pushgraph.graph.joint_fit import MEASURED, JointFits, turning
from pushgraph.graph.scene_batch import JOINT_CODES, Relations, pairs_of
from pushgraph.graph.state import State
from pushgraph.pose import as_complex
from pushgraph.scene import SLIDE, SWING

SIGNIFICANT = 2.0
"""A hinge's anchor is moved by what was seen if that moves it by so many of its standard deviations."""
ALONG_CENTRES = 0.94
"""Cosine of the angle to the line of centres up to which a slider is taken to stop where its bodies touch."""


class JointPlaces(NamedTuple):
    """Where the joint of each pair sits, were it a hinge or a slider, in the frame of a; see `Relations`.

    anchor_a, anchor_b: of the hinge, anchor_b in the frame of b (m). anchor_spread: standard deviation (m). axis: of
    the slider. axis_spread: standard deviation (rad). turned, slid: lowest and highest that was reached, of b relative
    to a, since the memory began (rad, m).
    """

    anchor_a: Float[Tensor, "batch pairs 2"]
    anchor_b: Float[Tensor, "batch pairs 2"]
    anchor_spread: Float[Tensor, "batch pairs"]
    axis: Float[Tensor, "batch pairs 2"]
    axis_spread: Float[Tensor, "batch pairs"]
    turned: Float[Tensor, "batch pairs 2"]
    slid: Float[Tensor, "batch pairs 2"]


def joint_places(state: State, fits: JointFits) -> JointPlaces:
    """Those of a scene that says no more (see `scene.place_joint`), unless what was seen moves them."""
    return _joint_places(state.relations, _centres(state.relations), fits)


def _joint_places(relations: Relations, between: Float[Tensor, "batch pairs 2"], fits: JointFits) -> JointPlaces:
    centres = as_complex(between.double())
    default = centres / centres.abs().clamp(min=1e-9)
    hinge, slider = fits.hinge(), fits.slider(default)

    significant = (hinge.anchor_a + hinge.anchor_b).abs() / 2 > SIGNIFICANT * hinge.spread
    to_b = turning(-relations.yaw_offset.double())
    moved = torch.stack((hinge.anchor_a, hinge.anchor_b * to_b), -1) * significant[..., None]
    anchors = torch.stack((relations.anchor_a, relations.anchor_b), -2) + torch.view_as_real(moved)

    axis = slider.axis
    axis = torch.where((axis * default.conj()).real < 0, -axis, axis)
    ends = torch.stack((fits.first_drift, fits.last_drift), -1)
    reached = (ends * axis[..., None].conj()).real.sort(-1).values
    return JointPlaces(
        anchors[..., 0, :],
        anchors[..., 1, :],
        hinge.spread,
        torch.view_as_real(axis),
        slider.across.clamp(min=MEASURED) / (slider.along.clamp(min=1e-9) * fits.frames.sqrt()),
        torch.stack((fits.lowest_turn, fits.highest_turn), -1),
        torch.stack((reached[..., 0].clamp(max=0), reached[..., 1].clamp(min=0)), -1),
    )


def believe(state: State, kind: Int[Tensor, "batch pairs"], fits: JointFits) -> State:
    """The state with every unknown pair joined as `kind` says, where the memory has it; all pairs count as known then.

    Joints sit where `joint_places` has them, and may move as far as those of a scene that says no more, or as far as
    they have moved. fits: to what was seen.
    """
    relations = state.relations
    unknown = relations.remembered & ~relations.known
    kind = torch.where(unknown, kind, relations.kind)
    centres = _centres(relations)
    places = _joint_places(relations, centres, fits)
    revolute, prismatic = kind == JOINT_CODES["revolute"], kind == JOINT_CODES["prismatic"]

    turns = unknown & revolute
    along = (places.axis * centres).sum(-1) > ALONG_CENTRES * centres.norm(dim=-1)
    stops = prismatic & along
    lowest = torch.where(stops, -_gap(state, centres).double(), -SLIDE) if stops.any() else -SLIDE
    slide = torch.stack((places.slid[..., 0].clamp(max=lowest), places.slid[..., 1].clamp(min=SLIDE)), -1)
    swing = torch.stack((places.turned[..., 0].clamp(max=-SWING), places.turned[..., 1].clamp(min=SWING)), -1)
    limits = torch.where(prismatic[..., None], slide, swing)
    limits = torch.where((prismatic | revolute)[..., None], limits, 0.0)

    def put(old: Tensor, new: Tensor, where: Bool[Tensor, "batch pairs"]) -> Tensor:
        return torch.where(where[..., None], new.to(old.dtype), old)

    return state._replace(
        relations=relations._replace(
            kind=kind,
            known=torch.ones_like(relations.known),
            remembered=kind > 0,
            anchor_a=put(relations.anchor_a, places.anchor_a, turns),
            anchor_b=put(relations.anchor_b, places.anchor_b, turns),
            axis=put(relations.axis, places.axis, unknown),
            limits=put(relations.limits, limits, unknown),
        )
    )


def _centres(relations: Relations) -> Float[Tensor, "batch pairs 2"]:
    """From the centre of a to that of b when the memory began, in the frame of a (m)."""
    return relations.anchor_a - pose.rotate(relations.anchor_b, relations.yaw_offset)


def _gap(state: State, centres: Float[Tensor, "batch pairs 2"]) -> Float[Tensor, "batch pairs"]:
    """Between the surfaces of the two when the memory began (m). centres: see `_centres`."""
    boxes = state.scenes.boxes
    ends = pairs_of(state.poses.shape[1], state.poses.device)
    first, second = (RoundedBox(boxes.half_extents[:, end], boxes.radius[:, end]) for end in ends)
    return signed_gap(first, second, torch.cat((centres, state.relations.yaw_offset[..., None]), -1)).clamp(min=0)
