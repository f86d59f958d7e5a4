"""What a frame shows about every pair of bodies: joint memory, how both moved, and how the prediction was wrong.

Twice, once in the frame of either body: x along the line of centres when the pair was first adjacent, carried by
the receiver. So features do not change when the scene is moved or turned, and neither body comes first.
"""

import torch
from jaxtyping import Bool, Complex, Float
from torch import Tensor

from pushgraph.graph import camera_noise, joint_fit
from pushgraph.graph.broad_phase import LEVER
from pushgraph.graph.joint_fit import turning
from pushgraph.graph.misfit import Misfit, misfit
from pushgraph.graph.scene_batch import pairs_of
from pushgraph.graph.watching import LONGEST_REST, Frame
from pushgraph.pose import as_complex, wrap_angle

FINE = 0.001
"""Lengths (m), and turns at LEVER, stand as the inverse hyperbolic sine in this unit: fine near zero, not large."""

FEATURES = (
    *("drift_x", "drift_y", "turn", "stretch"),
    *("drifting_x", "drifting_y", "turning"),
    *(f"{end}_{what}_{part}" for what in ("motion", "surprise") for end in ("receiver", "sender") for part in "xyt"),
    *(f"{end}_{what}" for end in ("receiver", "sender") for what in ("travel", "turned", "anchor_x", "anchor_y")),
    *("receiver_cylinder", "sender_cylinder", "receiver_yaw_known", "sender_yaw_known"),
    *("adjacent_at_first", "linked", "down"),
    *("hinge_x", "hinge_y", "drift_spread", "turn_spread", "turn_range"),
    *("hinge_residual", "hinge_deviation", "hinge_deviating"),
    *("slider_across", "slider_along", "slider_deviation", "slider_deviating"),
    *("slider_line_x", "slider_line_y", "hinge_spread", "frames_moved"),
    *("noise_position", "noise_yaw"),
    *(f"{what}_misfit" for what in Misfit._fields),
    *("frames_rested", "frames_resting"),
)
CONSTANTS = {"fine": FINE, "lever": LEVER, "longest_rest": LONGEST_REST} | camera_noise.CONSTANTS | joint_fit.CONSTANTS
"""What the weights depend on beside the features' names."""


def pair_evidence(
    frame: Frame, predicted: Float[Tensor, "batch bodies 3"], linked: Bool[Tensor, "batch pairs"]
) -> Float[Tensor, "batch pairs 2 features"]:
    """Features of all pairs; they mean something where the frame's `after` remembers the pair.

    predicted: motion foreseen from `before` to `after`. linked: pairs that share edges in the prediction's graph.
    """
    before, after, first = frame.before, frame.after, frame.first
    a, b = pairs_of(first.shape[1], first.device)
    scenes, relations = after.scenes, after.relations
    ends = torch.stack((a, b), -1)

    # Planar vectors are complex numbers here: to turn is to multiply. The last axis is for the two directions.
    anchors = torch.stack((as_complex(relations.anchor_a), as_complex(relations.anchor_b)), -1)
    offset = torch.stack((relations.yaw_offset, -relations.yaw_offset), -1)
    others = anchors.flip(-1) * turning(offset)  # as they stood in the receiver's frame when the memory began
    distance = (anchors - others).abs()
    axis = (anchors - others) / distance.clamp(min=1e-6)

    # How far anchors, angle and distance are from what they were, before and after.
    poses = torch.stack((before.poses, after.poses))
    position, yaw = as_complex(poses[..., :2]), poses[..., 2]
    turned_ends = turning(yaw[..., ends].float())
    to_axis = (turned_ends * axis).conj()
    centres = (position[..., b] - position[..., a]).to(anchors.dtype)
    reach = anchors * turned_ends
    apart = centres + reach[..., 1] - reach[..., 0]
    drift = torch.stack((apart, -apart), -1) * to_axis
    turned = (yaw[..., b] - yaw[..., a]).float()
    turn = wrap_angle(torch.stack((turned, -turned), -1) - offset) * LEVER
    stretch = centres.abs()[..., None] - distance

    # Of both ends: motions and surprises in the receiver's axis, and how far each has come.
    since = (after.poses - first).float()
    moves = torch.stack((after.motions, after.motions - predicted), 2).float()
    bodies = torch.cat(
        (
            moves.flatten(2),
            since[..., :2].norm(dim=-1, keepdim=True),
            since[..., 2:].abs() * LEVER,
            torch.stack((scenes.is_cylinder, scenes.yaw_known), -1).float(),
        ),
        -1,
    )
    of_ends = bodies.index_select(1, ends.flatten()).unflatten(1, ends.shape)
    of_ends = torch.stack((of_ends, of_ends.flip(2)), 3)  # [batch, pairs, direction, receiver or sender, numbers]
    moves = of_ends[..., :6].unflatten(-1, (2, 3)).transpose(3, 4)
    along = as_complex(moves[..., :2]) * to_axis[0, ..., None, None]
    moves = torch.cat((torch.view_as_real(along), moves[..., 2:] * LEVER), -1).flatten(3)
    receiver, sender = of_ends[..., 6:].unbind(3)
    receiver_anchor, sender_anchor = (torch.view_as_real(end * axis.conj()) / LEVER for end in (anchors, others))
    fine = torch.cat(
        (
            torch.view_as_real(drift[1]),
            turn[1, ..., None],
            stretch[1, ..., None],
            torch.view_as_real(drift[1] - drift[0]),
            wrap_angle((turn[1] - turn[0]) / LEVER)[..., None] * LEVER,
            moves,
            receiver[..., :2],
            sender[..., :2],
        ),
        -1,
    )
    fine = (fine / FINE).asinh()
    spread = frame.noise.spread
    noise = spread.float() * fine.new_tensor([1 / FINE, LEVER / FINE])
    down = frame.control.down[:, None].expand_as(linked)
    of_pair = torch.stack((frame.adjacent_at_first, linked, down), -1).float()
    centres_of_a = (distance * axis)[..., 0].to(torch.complex128)
    columns = (
        *(fine[..., :-4], fine[..., -4:-2], receiver_anchor, fine[..., -2:], sender_anchor),
        *(receiver[..., 2:3], sender[..., 2:3], receiver[..., 3:], sender[..., 3:]),
        of_pair[:, :, None].expand(-1, -1, 2, -1),
        _fit_evidence(frame, axis[..., 0].to(torch.complex128)).float(),
        noise.asinh()[:, None, None].expand(*fine.shape[:3], -1),
        _misfit_evidence(frame, spread, centres_of_a).float()[:, :, None].expand(-1, -1, 2, -1),
    )
    return torch.cat(columns, -1)


def _misfit_evidence(
    frame: Frame, spread: Float[Tensor, "batch 2"], centres: Complex[Tensor, "batch pairs"]
) -> Float[Tensor, "batch pairs misfit_features"]:
    """What the camera's noise does not explain, and of how many frames it is the mean.

    spread: of that noise, see `CameraNoise`. centres: see `misfit`.
    """
    relations, fits = frame.after.relations, frame.fits
    position, yaw = frame.noise.variance(spread).unbind(-1)
    levers = (relations.anchor_a.double().square() + relations.anchor_b.double().square()).sum(-1)
    drift_noise = (2 * position[:, None] + levers / 2 * yaw[:, None]).sqrt()
    turn_noise = (2 * yaw).sqrt()[:, None].expand_as(drift_noise)
    off = misfit(fits, frame.relative, frame.resting, drift_noise, turn_noise, centres)
    return torch.cat((torch.stack(off, -1).asinh(), torch.stack((fits.rested, frame.resting), -1).log()), -1)


def _fit_evidence(frame: Frame, axis: Complex[Tensor, "batch pairs"]) -> Float[Tensor, "batch pairs 2 fit_features"]:
    """How well each joint fits what was seen before this frame, and this frame. axis: of the pair's frame, in a's."""
    fits, hinge, slider = frame.fits, frame.fits.hinge(), frame.fits.slider(axis)
    off_hinge, off_slider = hinge.deviation(frame.relative), slider.deviation(frame.relative)
    fine = torch.stack(
        (
            fits.drift_spread,
            fits.turn_spread * LEVER,
            fits.turn_range,
            hinge.residual,
            off_hinge.abs(),
            (off_hinge - hinge.deviation(frame.relative_before)).abs(),
            slider.across,
            slider.along,
            off_slider.abs(),
            (off_slider - slider.deviation(frame.relative_before)).abs(),
        ),
        -1,
    )
    fine = (fine / FINE).asinh()
    line = (slider.axis * axis.conj()).square() * slider.along / (slider.along + FINE)  # an axis has no sign
    either = torch.cat(
        (
            fine,
            torch.view_as_real(line),
            torch.stack((hinge.spread / FINE, fits.frames), -1).log(),
        ),
        -1,
    )
    anchor = torch.stack((hinge.anchor_a * axis.conj(), -hinge.anchor_b * axis.conj()), -1)
    anchor = torch.view_as_real(anchor / LEVER).asinh()
    return torch.cat((anchor, either[:, :, None].expand(-1, -1, 2, -1)), -1)
