"""Solve the contact problems of many scenes side by side, by Newton's method with an exact line search.

What slips is let stick in part at first (eps falls from LOOSE to SLIP), which leads to the solution in a few
iterations. Scenes that have converged are left alone while the others go on.
"""

from collections.abc import Callable
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from pushgraph.network.contact_problem import SLIP, ContactProblem, Linearized, Moment

ITERATIONS = 60
LOOSE, TIGHTENING = 0.3, 0.5
"""eps of the first iteration, and by what it is multiplied in each."""
SECANT = 0.9
"""Share of the curvature that friction loses along the slip: all of it (Newton) fails far from the solution, none of it
(reweighted least squares) is slow."""
CONVERGED = 1e-4
"""A scene whose twists change by less than this, in steps, is solved."""
BALANCED = 1e-3
"""And friction must be held to normal forces that are off by less than this, in weights of what may move."""
OUTRIGHT, SHARES = 6, (0.1, 8.0)
"""For so many iterations friction follows the normal forces outright; then it follows a share between these."""
BRACKETINGS, INSIDE, TINY = 3, (0.1, 0.9), 1e-12
"""Rounds of the line search, by regula falsi; and which share of the bracket each may take away."""
DAMPING = 1e-9
"""The curvature's diagonal is so much larger, in shares, that rounding leaves it positive."""
MANY = 0.4
"""While at least this share of the scenes still moves, all go on."""
FEW = 24
"""So few systems are solved one by one, by LAPACK."""
LARGE = 64
"""Unknowns of a scene from which on LAPACK is faster, however many scenes there are."""


def solve(problem: ContactProblem) -> Float[Tensor, "3 nodes"]:
    """Twists of all nodes at which forces balance; differentiable in all that the problem holds."""
    if bool(problem.given.all()):
        return problem.last
    with torch.no_grad():
        twist = _solved(problem, problem.last, None, 0)
    return _differentiable(problem, torch.where(problem.given, problem.last, twist))


class Held(NamedTuple):
    """Normal forces that friction is held to, how far those that they lead to were off, and the share of such a
    difference that is followed."""

    pressing: Float[Tensor, " contacts"]
    off: Float[Tensor, " contacts"]
    share: Float[Tensor, " contacts"]

    def following(self, pressing: Float[Tensor, " contacts"], layout: "Layout", iteration: int) -> "Held":
        """The same after a twist that leads to other forces.

        Friction changes the forces that it depends on: following them outright is slow where they grow together, and
        never ends where they go to and fro. So the share is estimated from the last two differences, for each scene
        (Aitken's relaxation).
        """
        off = pressing - self.pressing
        share = self.share
        if iteration > OUTRIGHT:
            change = off - self.off
            sums = torch.zeros(2, layout.count + 1, dtype=off.dtype, device=off.device)
            sums.index_add_(1, layout.point_row[: len(off)], torch.stack((self.off * change, change.square())))
            factor = -sums[0] / sums[1].clamp(min=TINY)
            factor = torch.where(sums[1] > TINY, factor, 1.0).index_select(0, layout.point_row[: len(off)])
            share = (share * factor).clamp(*SHARES)
        return Held((self.pressing + share * off).clamp(min=0), off, share)


def _solved(problem: ContactProblem, twist: Tensor, held: Held | None, iteration: int) -> Float[Tensor, "3 nodes"]:
    """The solution from an iteration on; scenes that have converged are then left out."""
    layout = Layout(problem)
    while iteration < ITERATIONS:
        slip = max(LOOSE * TIGHTENING**iteration, SLIP)
        twist, held, moves = _iterate(problem, layout, twist, held, iteration, slip)
        iteration += 1
        if slip > SLIP:
            continue
        left = int(moves.sum())
        if left == 0:
            break
        if left < MANY * len(moves):
            nodes = moves[layout.row_of_all].nonzero().squeeze(-1)
            part, contacts = problem.part(nodes)
            held = Held(*(values[contacts] for values in held))
            twist[:, nodes] = _solved(part, twist[:, nodes], held, iteration)
            break
    return twist


def _differentiable(problem: ContactProblem, twist: Tensor) -> Tensor:
    """The same twists, with the gradients of the solution: where the energy's gradient g(u, a) is zero, du is
    -(dg/du)^-1 dg/da da (implicit function theorem)."""
    if not (torch.is_grad_enabled() and problem.differentiable(twist)):
        return twist
    layout = Layout(problem)
    at = problem.linearize(twist, SLIP, 1.0)
    gradient = at.linearized().gradient
    with torch.no_grad():
        exact = layout.exact(at)
    moved = layout.solve_exact(exact, gradient)
    return twist - (moved - moved.detach())


def _iterate(
    problem: ContactProblem, layout: "Layout", twist: Tensor, held: Held | None, iteration: int, slip: float
) -> tuple[Float[Tensor, "3 nodes"], Held, Bool[Tensor, " scenes"]]:
    """One iteration: the twists, what friction was held to, and which scenes are not solved yet."""
    moment = problem.linearize(twist, slip, SECANT)
    pressing = moment.pressing
    if held is None:
        held = Held(pressing, torch.zeros_like(pressing), torch.ones_like(pressing))
    else:
        held = held.following(pressing, layout, iteration)
    moment.hold(held.pressing)
    linearized = moment.linearized()
    direction = layout.direction(linearized)
    slope = moment.slope(direction)
    of = layout.foot_row, layout.row, layout.point_row
    falling = torch.zeros(layout.count + 1, dtype=twist.dtype, device=twist.device)
    falling.index_add_(0, layout.row, (linearized.gradient * direction).sum(0))
    length = _where_flat(lambda at: slope.at(at, *of), falling)
    step = direction * length.index_select(0, layout.row)
    change = torch.zeros_like(length).scatter_reduce(0, layout.row, step.abs().amax(0), "amax")
    off = torch.zeros_like(length).scatter_reduce(0, layout.point_row[: len(held.off)], held.off.abs(), "amax")
    return twist + step, held, ((change >= CONVERGED) | (off >= BALANCED))[:-1]


def _where_flat(
    slope: Callable[[Tensor], Tensor], below: Float[Tensor, " scenes"]
) -> Float[Tensor, " scenes"]:
    """Lengths from 0 to 1 at which the energies are least: where their slopes, which rise from `below`, pass zero."""
    low, high = torch.zeros_like(below), torch.ones_like(below)
    above = slope(high)
    whole = above <= 0
    for _ in range(BRACKETINGS):
        if bool(whole.all()):
            break
        share = (-below / (above - below).clamp(min=TINY)).clamp(*INSIDE)
        middle = low + share * (high - low)
        now = slope(middle)
        short = now <= 0
        low, below = torch.where(short, middle, low), torch.where(short, now, below)
        high, above = torch.where(short, high, middle), torch.where(short, above, now)
    share = (-below / (above - below).clamp(min=TINY)).clamp(0, 1)
    return torch.where(whole, 1.0, low + share * (high - low))


class Layout:
    """Where numbers of nodes and points stand in the linear systems, one for each scene with free nodes.

    Matrices are [3 size, 3 size, scenes], the scenes last, `size` being the most free nodes of a scene. row: the system
    of each node, `count` for nodes whose motion is given; row_of_all: of those, too.
    """

    def __init__(self, problem: ContactProblem) -> None:
        given = problem.given
        self.free = (~given).nonzero().squeeze(-1)
        scene, row = problem.scene[self.free].unique_consecutive(return_inverse=True)
        self.count = count = len(scene)
        sizes = row.bincount(minlength=count)
        width = 3 * int(sizes.max())
        self.row = torch.full_like(problem.scene, count).index_copy(0, self.free, row)
        self.row_of_all = torch.searchsorted(scene, problem.scene).clamp(max=count - 1)
        place = 3 * (torch.arange(len(row), device=row.device) - (sizes.cumsum(0) - sizes)[row])
        self.place = torch.zeros_like(problem.scene).index_copy(0, self.free, place)
        points = problem.points
        rows = self.row.index_select(0, torch.stack((points.first, points.second)).flatten()).view(2, -1)
        self.foot_row = self.row.index_select(0, problem.feet.node)
        self.point_row = rows.amin(0)
        steps = torch.arange(3, device=row.device)[:, None]
        self.vector = (place + steps) * count + row
        of_row, of_column = place + _LOWER.to(row.device)[..., None]
        self.own = (of_row * width + of_column) * count + row
        self.coupled = (rows.amax(0) < count).nonzero().squeeze(-1)
        first, second = (self.place[ends[self.coupled]] for ends in (points.first, points.second))
        first, second = torch.broadcast_tensors((first + steps)[:, None], (second + steps)[None])
        low, high = torch.minimum(first, second), torch.maximum(first, second)
        between = (high * width + low) * count + self.point_row[self.coupled]
        self.between = between.flatten(0, 1)
        # What a system does not hold gets ones on the diagonal.
        there = problem.gap.new_zeros(width * count).index_fill_(0, self.vector.flatten(), 1.0)
        self.missing = (1 - there).view(width, count)

    def direction(self, at: Linearized) -> Float[Tensor, "3 nodes"]:
        """Newton's direction; zero for given nodes."""
        right = torch.zeros_like(self.missing).flatten()
        right[self.vector.flatten()] = -at.gradient.index_select(1, self.free).flatten()
        found = solve_positive(self.assembled(at), right.view_as(self.missing)).reshape(-1)[self.vector]
        return torch.zeros_like(at.gradient).index_copy(1, self.free, found)

    def assembled(self, at: Linearized) -> Float[Tensor, "unknowns unknowns scenes"]:
        """Lower triangles of the curvature."""
        width, count = self.missing.shape
        matrix = torch.zeros(width * width * count, dtype=at.own.dtype, device=at.own.device)
        matrix.index_add_(0, self.own.flatten(), at.own.index_select(1, self.free).flatten())
        matrix.index_add_(0, self.between.flatten(), at.between.index_select(1, self.coupled).flatten())
        matrix = matrix.view(width, width, count)
        matrix.diagonal().mul_(1 + DAMPING).add_(self.missing.t())
        return matrix

    def exact(self, at: Moment) -> Float[Tensor, "scenes unknowns unknowns"]:
        """Derivative of the energy's gradient, friction's dependence on normal forces included."""
        width, count = self.missing.shape
        lower = self.assembled(at.linearized()).permute(2, 0, 1)
        matrix = (lower + lower.tril(-1).mT).contiguous()
        problem, contacts = at.problem, at.problem.contacts
        n_x, n_y = problem.normal
        weakens = -problem.friction * problem.stiffness * (at.depth > 0) * at.tangential * at.grip_length
        (x_1, y_1), (x_2, y_2) = problem.points.first_arm[:, :contacts], problem.points.second_arm[:, :contacts]
        normal = torch.stack((-n_x, -n_y, y_1 * n_x - x_1 * n_y, n_x, n_y, x_2 * n_y - y_2 * n_x))
        tangent = torch.stack((n_y, -n_x, -y_1 * n_y - x_1 * n_x, -n_y, n_x, x_2 * n_x + y_2 * n_y))
        ends = torch.stack((problem.points.first[:contacts], problem.points.second[:contacts]))
        place = self.place[ends][:, None] + torch.arange(3, device=ends.device)[:, None]
        free = (self.row[ends] < count)[:, None].expand(-1, 3, -1).flatten(0, 1)
        place, row = place.flatten(0, 1), self.point_row[:contacts]
        values = tangent[:, None] * normal[None] * weakens
        valid = free[:, None] & free[None]
        index = (row * width + place[:, None]) * width + place[None]
        matrix.view(-1).index_add_(0, index[valid], values[valid])
        return matrix

    def solve_exact(self, matrix: Tensor, gradient: Float[Tensor, "3 nodes"]) -> Float[Tensor, "3 nodes"]:
        """The gradient's values multiplied by the inverse; differentiable in them."""
        right = gradient.new_zeros(self.missing.numel()).index_copy(
            0, self.vector.flatten(), gradient.index_select(1, self.free).flatten()
        )
        found = torch.linalg.solve(matrix, right.view_as(self.missing).t()).t().reshape(-1)[self.vector]
        return torch.zeros_like(gradient).index_copy(1, self.free, found)


_LOWER = torch.tensor(((0, 1, 1, 2, 2, 2), (0, 0, 1, 0, 1, 2)))
"""Rows and columns of a node's own curvature, in the order of `Linearized.own`: xx, xy, yy, xt, yt, tt."""


def solve_positive(
    matrix: Float[Tensor, "n n systems"], right: Float[Tensor, "n systems"]
) -> Float[Tensor, "n systems"]:
    """Solve positive definite systems, of which only the lower triangles are read; both arguments are overwritten.

    One step of the elimination works through all systems at once, in long rows.
    """
    n, systems = right.shape
    if n > LARGE or (systems <= FEW and matrix.device.type == "cpu"):
        factor = torch.linalg.cholesky_ex(matrix.permute(2, 0, 1))[0]
        return torch.cholesky_solve(right.t()[..., None], factor)[..., 0].t()
    columns = []
    for k in range(n - 1):
        column = matrix[k + 1 :, k] / matrix[k, k]
        matrix[k + 1 :, k + 1 :].addcmul_(column[:, None], matrix[k + 1 :, k][None], value=-1)
        right[k + 1 :].addcmul_(column, right[k][None], value=-1)
        columns.append(column)
    right /= matrix.diagonal().t()
    for k in range(n - 2, -1, -1):
        right[k] -= (columns[k] * right[k + 1 :]).sum(0)
    return right
