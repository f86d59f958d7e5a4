"""What holds in one step: friction on the table, contacts without penetration, Coulomb friction there, joints, inertia.

The unknowns are the twists u of the free pieces, in the units of `pushgraph.graph.contact_graph`; forces are counted in
mu_table g times the mass that may move in the scene. They balance where this energy has its minimum:

    E(u) = sum_feet     w sqrt(d . M d + (rho omega)^2 + eps^2)       friction on the table; d: how a foot moves
         + sum_pieces   1/2 c m (|v - v_last|^2 + k^2 (omega - omega_last)^2)     inertia; k^2: gyration
         + sum_contacts 1/2 K min(0, gap + n . d)^2                    no penetration; d: how the two sides part
         + sum_contacts mu N sqrt((t . d)^2 + eps^2)                   friction there
         + sum_joints   1/2 K_j |drift + d|^2 and the like             hinges, sliders, limits
         + sum_tools    F sqrt((a . d)^2 + eps^2) + 1/2 K_j |a x d|^2 and the like     limited drives; d: off the plan
         - sum_contacts f . d                                          what the network corrects

M is the unit matrix, but on tables with a grain. N is K max(0, -gap - n . d) of the last u. It is held while E is
minimized and then taken anew, so that there is no dilation: friction is Coulomb's. Every term that acts between two
pieces acts on their relative motion, so its forces are equal and opposite.
"""

from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from pushgraph.graph.contact_graph import ContactGraph, Drives, Feet, Joints, Points, relative_motion

STIFFNESS = 100.0
"""K: a contact that carries the friction of all that moves is pressed in by a hundredth of the step."""
JOINT_STIFFNESS = 1e3
"""K_j."""
SLIP = 0.01
"""eps: what slips by less than this, in steps, sticks, in part."""
FARTHEST = 6.0
"""No piece moves farther in a step than this, in lengths of the step: long levers do, at most."""
CONTACT_STATE = ("gap", "parts", "slips", "presses")
"""What is foreseen of a contact: its gap at the start and how much it opens (steps), how far the sender slips to the
left, all three clamped, and log(1 + force), in weights of what may move."""

CONSTANTS = {"stiffness": STIFFNESS, "joint_stiffness": JOINT_STIFFNESS, "slip": SLIP}
"""What predictions depend on."""


class Correction(NamedTuple):
    """What a network makes better. Of each contact: gap (steps), factor of its friction, force on the second in its
    contact frame, and of each node: factor of its friction on the table."""

    gap: Float[Tensor, " contacts"]
    friction: Float[Tensor, " contacts"]
    force: Float[Tensor, "2 contacts"]
    table_friction: Float[Tensor, " nodes"]


class Linearized(NamedTuple):
    """Gradient of the energy, and its curvature: of each node by itself (xx, xy, yy, xt, yt, tt), and between the two
    nodes of a point (rows of the first times columns of the second)."""

    gradient: Float[Tensor, "3 nodes"]
    own: Float[Tensor, "6 nodes"]
    between: Float[Tensor, "9 points"]


class ContactProblem(NamedTuple):
    """Energy of one step, as the module says. Points are those of the contacts, then those of the joints.

    scene, given: of each node. inertia: c m, c m, c m k^2. last: twists if nothing acts, and those that are given.
    stiffness: K. force: of the network, along and across each normal. hinge, slider: 1 for joints that are one, else 0.
    """

    scene: Int[Tensor, " nodes"]
    given: Bool[Tensor, " nodes"]
    inertia: Float[Tensor, "3 nodes"]
    last: Float[Tensor, "3 nodes"]
    feet: Feet
    points: Points
    normal: Float[Tensor, "2 contacts"]
    gap: Float[Tensor, " contacts"]
    friction: Float[Tensor, " contacts"]
    stiffness: Float[Tensor, " contacts"]
    force: Float[Tensor, "2 contacts"]
    joints: Joints
    hinge: Float[Tensor, " joints"]
    slider: Float[Tensor, " joints"]
    drives: Drives

    @classmethod
    def of(cls, graph: ContactGraph, correction: Correction | None = None) -> "ContactProblem":
        """The problem of a graph, corrected or as it is."""
        nodes, contacts, joints, feet = graph.nodes, graph.contacts, graph.joints, graph.feet
        gap, friction, force = contacts.gap, contacts.friction, torch.zeros_like(contacts.normal)
        if correction is not None:
            gap, friction, force = gap + correction.gap, friction * correction.friction, correction.force
            feet = feet._replace(weight=feet.weight * correction.table_friction.index_select(0, feet.node))
        mass = torch.where(nodes.is_tool, 0.0, nodes.mass * nodes.inertia)
        hinge = joints.revolute.to(mass.dtype)
        return cls(
            scene=nodes.scene,
            given=nodes.given,
            inertia=torch.stack((mass, mass, mass * nodes.gyration)),
            last=nodes.last_twist,
            feet=feet,
            points=Points(*(torch.cat(pair, -1) for pair in zip(contacts.points, joints.points, strict=True))),
            normal=contacts.normal,
            gap=gap,
            friction=friction,
            stiffness=STIFFNESS * contacts.share,
            force=force,
            joints=joints,
            hinge=hinge,
            slider=1 - hinge,
            drives=graph.drives,
        )

    @property
    def contacts(self) -> int:
        """So many of the points are contacts."""
        return len(self.gap)

    def part(self, kept: Int[Tensor, " kept"]) -> tuple["ContactProblem", Int[Tensor, " contacts"]]:
        """The same with some of the nodes, those of whole scenes; and which contacts it holds."""
        place = torch.full_like(self.scene, -1)
        place[kept] = torch.arange(len(kept), device=kept.device)
        feet = (place.index_select(0, self.feet.node) >= 0).nonzero().squeeze(-1)
        points = (place.index_select(0, self.points.first) >= 0).nonzero().squeeze(-1)
        contacts = points[points < self.contacts]
        joints = points[len(contacts) :] - self.contacts
        taken = Points(*(values.index_select(-1, points) for values in self.points))
        taken = taken._replace(first=place[taken.first], second=place[taken.second])
        _, *of_joints = self.joints
        chosen = Feet(*(values.index_select(-1, feet) for values in self.feet))
        part = ContactProblem(
            scene=self.scene[kept],
            given=self.given[kept],
            inertia=self.inertia[:, kept],
            last=self.last[:, kept],
            feet=chosen._replace(node=place[chosen.node]),
            points=taken,
            normal=self.normal[:, contacts],
            gap=self.gap[contacts],
            friction=self.friction[contacts],
            stiffness=self.stiffness[contacts],
            force=self.force[:, contacts],
            joints=Joints(self.joints.points, *(values.index_select(-1, joints) for values in of_joints)),
            hinge=self.hinge[joints],
            slider=self.slider[joints],
            drives=self._part_of_drives(place),
        )
        return part, contacts

    def _part_of_drives(self, place: Int[Tensor, " nodes"]) -> Drives:
        kept = (place.index_select(0, self.drives.node) >= 0).nonzero().squeeze(-1)
        node, *rest = self.drives
        return Drives(place[node[kept]], *(values.index_select(-1, kept) for values in rest))

    def differentiable(self, twist: Tensor) -> bool:
        """Whether anything of it wants a gradient."""
        values = (twist, self.gap, self.force, self.normal, self.feet.weight, self.feet.arm, self.last)
        return any(one.requires_grad for one in (*values, self.drives.length, self.drives.limit))

    def linearize(self, twist: Float[Tensor, "3 nodes"], slip: float, secant: float) -> "Moment":
        """Everything about the energy at a twist.

        slip: eps. secant: the share of its curvature that friction loses along the slip.
        """
        return Moment(self, twist, slip, secant)


class Moment:
    """The energy near one twist: its gradient, a positive curvature, and its slope along a direction."""

    def __init__(self, problem: ContactProblem, twist: Tensor, slip: float, secant: float) -> None:
        self.problem, self.twist, self.slip, self.secant = problem, twist, slip, secant
        self.sliding = foot_motion(problem.feet, twist)
        self.foot_length = (_square(problem.feet, self.sliding, self.sliding) + slip**2).rsqrt()
        self.inertial = problem.inertia * (twist - problem.last)
        x, y, turn = relative_motion(problem.points, twist)
        count = problem.contacts
        n_x, n_y = problem.normal
        self.depth = -(problem.gap + x[:count] * n_x + y[:count] * n_y)
        self.tangential = y[:count] * n_x - x[:count] * n_y
        self.pressing = problem.stiffness * self.depth.clamp(min=0)
        self.grip = problem.friction * self.pressing
        self.grip_length = (self.tangential.square() + slip**2).rsqrt()
        joints = problem.joints
        self.joint_motion = x[count:], y[count:], turn[count:]
        self.drift_x, self.drift_y = joints.drift[0] + x[count:], joints.drift[1] + y[count:]
        self.turn = joints.turn + turn[count:]
        along = x[count:] * joints.axis[0] + y[count:] * joints.axis[1]
        self.used = problem.slider * along + problem.hinge * turn[count:]
        self.across = self.drift_y * joints.axis[0] - self.drift_x * joints.axis[1]
        drives = problem.drives
        x, y, self.off_turn = (twist - problem.last).index_select(1, drives.node)
        self.lag = x * drives.axis[0] + y * drives.axis[1]
        self.off_way = y * drives.axis[0] - x * drives.axis[1]

    def hold(self, pressing: Float[Tensor, " contacts"]) -> None:
        """Hold friction to other normal forces than those of the twist."""
        self.grip = self.problem.friction * pressing

    def linearized(self) -> Linearized:
        """Gradient and curvature."""
        problem, feet, points = self.problem, self.problem.feet, self.problem.points
        n_x, n_y = problem.normal
        # Feet.
        strength = feet.weight * self.foot_length
        m_xx, m_xy, m_yy = feet.metric
        x, y = measured(feet, self.sliding)
        turn = self.sliding[2]
        arm_x, arm_y = feet.arm
        s_xx, s_xy, s_yy = strength * m_xx, strength * m_xy, strength * m_yy
        s_xt, s_yt = s_xy * arm_x - s_xx * arm_y, s_yy * arm_x - s_xy * arm_y
        torque = arm_x * y - arm_y * x + feet.radius * turn
        less = self.secant * strength * self.foot_length.square()
        l_x, l_y = less * x, less * y
        rows = torch.stack(
            (
                s_xx - l_x * x,
                s_xy - l_x * y,
                s_yy - l_y * y,
                s_xt - l_x * torque,
                s_yt - l_y * torque,
                s_yt * arm_x - s_xt * arm_y + strength * feet.radius.square() - less * torque.square(),
                strength * x,
                strength * y,
                strength * torque,
            )
        )
        sums = torch.zeros(9, self.twist.shape[1], dtype=rows.dtype, device=rows.device).index_add_(1, feet.node, rows)
        own, gradient = sums[:6], sums[6:] + self.inertial
        own[0] += problem.inertia[0]
        own[2] += problem.inertia[1]
        own[5] += problem.inertia[2]
        if len(problem.drives.node):
            self._add_drives(own, gradient)

        # Contacts: force and stiffness at the point, on the relative motion, world axes.
        force_x, force_y, torque = self.forces()
        hold = problem.stiffness * (self.depth > 0)
        drag = self.grip * self.grip_length
        stick = drag * (1 - self.secant * (self.tangential * self.grip_length).square())
        k_xx = hold * n_x * n_x + stick * n_y * n_y
        k_xy = (hold - stick) * n_x * n_y
        k_yy = hold * n_y * n_y + stick * n_x * n_x
        k_tt = torch.zeros_like(k_xx)
        joints = problem.joints
        if len(joints.turn):
            a_x, a_y = joints.axis
            hinge, slider = JOINT_STIFFNESS * problem.hinge, JOINT_STIFFNESS * problem.slider
            low, high = self._past_limits()
            held = JOINT_STIFFNESS * ((low < 0) | (high < 0))
            held_x = held * problem.slider
            k_xx = torch.cat((k_xx, hinge + slider * a_y * a_y + held_x * a_x * a_x))
            k_xy = torch.cat((k_xy, (held_x - slider) * a_x * a_y))
            k_yy = torch.cat((k_yy, hinge + slider * a_x * a_x + held_x * a_y * a_y))
            k_tt = torch.cat((k_tt, slider + held * problem.hinge))
        (x_1, y_1), (x_2, y_2) = points.first_arm, points.second_arm
        xt_1, yt_1 = k_xy * x_1 - k_xx * y_1, k_yy * x_1 - k_xy * y_1
        xt_2, yt_2 = k_xy * x_2 - k_xx * y_2, k_yy * x_2 - k_xy * y_2
        tt_1, tt_2 = x_1 * yt_1 - y_1 * xt_1 + k_tt, x_2 * yt_2 - y_2 * xt_2 + k_tt
        tt = x_1 * yt_2 - y_1 * xt_2 + k_tt
        first = (k_xx, k_xy, k_yy, xt_1, yt_1, tt_1, -force_x, -force_y, y_1 * force_x - x_1 * force_y - torque)
        second = (k_xx, k_xy, k_yy, xt_2, yt_2, tt_2, force_x, force_y, x_2 * force_y - y_2 * force_x + torque)
        sums = torch.cat((own, gradient)).index_add_(1, points.first, torch.stack(first))
        sums.index_add_(1, points.second, torch.stack(second))
        between = -torch.stack((k_xx, k_xy, xt_2, k_xy, k_yy, yt_2, xt_1, yt_1, tt))
        return Linearized(sums[6:], sums[:6], between)

    def forces(self) -> tuple[Float[Tensor, " points"], Float[Tensor, " points"], Float[Tensor, " points"]]:
        """What the first node bears at every point, x, y and moment about it; the second bears the opposite."""
        problem = self.problem
        n_x, n_y = problem.normal
        along, across = -self.pressing, self.grip * self.grip_length * self.tangential
        along, across = along - problem.force[0], across - problem.force[1]
        force_x, force_y = along * n_x - across * n_y, along * n_y + across * n_x
        torque = torch.zeros_like(force_x)
        joints = problem.joints
        if len(joints.turn):
            a_x, a_y = joints.axis
            hinge, slider = JOINT_STIFFNESS * problem.hinge, JOINT_STIFFNESS * problem.slider
            low, high = self._past_limits()
            limit = JOINT_STIFFNESS * (low - high)
            limit_x = limit * problem.slider
            force_x = torch.cat((force_x, hinge * self.drift_x - slider * self.across * a_y + limit_x * a_x))
            force_y = torch.cat((force_y, hinge * self.drift_y + slider * self.across * a_x + limit_x * a_y))
            torque = torch.cat((torque, slider * self.turn + limit * problem.hinge))
        return force_x, force_y, torque

    def _past_limits(self) -> tuple[Float[Tensor, " joints"], Float[Tensor, " joints"]]:
        """The room that joints lack to their lower and upper limits, at most 0."""
        joints = self.problem.joints
        return (joints.low + self.used).clamp(max=0), (joints.high - self.used).clamp(max=0)

    def _add_drives(self, own: Float[Tensor, "6 nodes"], gradient: Float[Tensor, "3 nodes"]) -> None:
        """Add force and stiffness of what drives tools with a limit."""
        drives = self.problem.drives
        a_x, a_y = drives.axis
        length = (self.lag.square() + self.slip**2).rsqrt()
        along = drives.limit * length * self.lag
        stick = drives.limit * length * (1 - self.secant * (self.lag * length).square())
        across, turn = JOINT_STIFFNESS * self.off_way, JOINT_STIFFNESS * self.off_turn
        stiff = torch.full_like(stick, JOINT_STIFFNESS)
        none = torch.zeros_like(stick)
        k_xx, k_yy = stick * a_x * a_x + stiff * a_y * a_y, stick * a_y * a_y + stiff * a_x * a_x
        own.index_add_(1, drives.node, torch.stack((k_xx, (stick - stiff) * a_x * a_y, k_yy, none, none, stiff)))
        forces = torch.stack((along * a_x - across * a_y, along * a_y + across * a_x, turn))
        gradient.index_add_(1, drives.node, forces)

    def slope(self, direction: Float[Tensor, "3 nodes"]) -> "Slope":
        """The slope of the energy along a direction."""
        return Slope(self, direction)


class Slope:
    """dE/d(length) along a direction, each scene with a length of its own; friction's normal forces are held."""

    def __init__(self, moment: Moment, direction: Tensor) -> None:
        problem = moment.problem
        self.moment = moment
        sliding = foot_motion(problem.feet, direction)
        feet = problem.feet
        self.foot_now = _square(feet, moment.sliding, moment.sliding) + moment.slip**2
        self.foot_first = _square(feet, moment.sliding, sliding)
        self.foot_second = _square(feet, sliding, sliding)
        self.inertia_now = (moment.inertial * direction).sum(0)
        self.inertia_more = (problem.inertia * direction.square()).sum(0)
        x, y, turn = relative_motion(problem.points, direction)
        count = problem.contacts
        n_x, n_y = problem.normal
        self.parting = x[:count] * n_x + y[:count] * n_y
        self.slipping = y[:count] * n_x - x[:count] * n_y
        x, y, turn = x[count:], y[count:], turn[count:]
        joints = problem.joints
        self.using = problem.slider * (x * joints.axis[0] + y * joints.axis[1]) + problem.hinge * turn
        crossing = y * joints.axis[0] - x * joints.axis[1]
        hinge, slider = JOINT_STIFFNESS * problem.hinge, JOINT_STIFFNESS * problem.slider
        self.joint_now = hinge * (moment.drift_x * x + moment.drift_y * y) + slider * (
            moment.across * crossing + moment.turn * turn
        )
        self.joint_more = hinge * (x * x + y * y) + slider * (crossing * crossing + turn * turn)
        drives = problem.drives
        x, y, turn = direction.index_select(1, drives.node)
        self.lagging = x * drives.axis[0] + y * drives.axis[1]
        off_way = y * drives.axis[0] - x * drives.axis[1]
        self.drive_now = JOINT_STIFFNESS * (moment.off_way * off_way + moment.off_turn * turn)
        self.drive_more = JOINT_STIFFNESS * (off_way * off_way + turn * turn)

    def at(
        self, length: Float[Tensor, " scenes"], of_foot: Tensor, of_node: Tensor, of_point: Tensor
    ) -> Float[Tensor, " scenes"]:
        """The slope at a length; of_foot, of_node, of_point: the scenes of each, one more than there are for none."""
        moment, problem = self.moment, self.moment.problem
        count = problem.contacts
        total = torch.zeros_like(length)
        foot, node, point = (length.index_select(0, of) for of in (of_foot, of_node, of_point))
        grown = self.foot_now + foot * (2 * self.foot_first + foot * self.foot_second)
        feet = problem.feet.weight * (self.foot_first + foot * self.foot_second) * grown.rsqrt()
        total.index_add_(0, of_foot, feet)
        total.index_add_(0, of_node, self.inertia_now + node * self.inertia_more)
        if len(problem.drives.node):
            of_drive = of_node.index_select(0, problem.drives.node)
            drive = length.index_select(0, of_drive)
            lag = moment.lag + drive * self.lagging
            pull = problem.drives.limit * lag * (lag.square() + moment.slip**2).rsqrt() * self.lagging
            total.index_add_(0, of_drive, pull + self.drive_now + drive * self.drive_more)
        contact = point[:count]
        slip = moment.tangential + contact * self.slipping
        pressing = problem.stiffness * (moment.depth - contact * self.parting).clamp(min=0)
        friction = moment.grip * slip * (slip.square() + moment.slip**2).rsqrt()
        slope = friction * self.slipping - pressing * self.parting
        slope = slope - problem.force[0] * self.parting - problem.force[1] * self.slipping
        if len(problem.joints.turn):
            joint = point[count:]
            used = moment.used + joint * self.using
            limits = (problem.joints.low + used).clamp(max=0) - (problem.joints.high - used).clamp(max=0)
            of_joints = self.joint_now + joint * self.joint_more + JOINT_STIFFNESS * limits * self.using
            slope = torch.cat((slope, of_joints))
        return total.index_add_(0, of_point, slope)


def foot_motion(feet: Feet, twist: Float[Tensor, "3 nodes"]) -> tuple[Tensor, Tensor, Tensor]:
    """How feet slide, x and y, and the slide that stands for their spin."""
    x, y, turn = twist.index_select(1, feet.node)
    return x - feet.arm[1] * turn, y + feet.arm[0] * turn, feet.radius * turn


def measured(feet: Feet, sliding: tuple[Tensor, Tensor, Tensor]) -> tuple[Tensor, Tensor]:
    """M d: the direction of friction, x and y."""
    m_xx, m_xy, m_yy = feet.metric
    x, y, _ = sliding
    return m_xx * x + m_xy * y, m_xy * x + m_yy * y


def _square(feet: Feet, one: tuple[Tensor, Tensor, Tensor], other: tuple[Tensor, Tensor, Tensor]) -> Tensor:
    """d . M d' of two slides, and what their spins add."""
    x, y = measured(feet, one)
    return x * other[0] + y * other[1] + one[2] * other[2]
