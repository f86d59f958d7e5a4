"""What holds for one rigid body in a short step in space: inertia, contacts without penetration, Coulomb friction.

The unknown is the body's velocity v at the end of the step (linear and angular, world axes). It minimizes the convex

    E(v) = 1/2 (v - v_free)' M (v - v_free) + sum_contacts 1/2 R |p|^2,    p = project((w m - d) / R)

d: how the body moves past the other surface at the contact. m: which way that one pushes. w: the speed at which they
shall part, minus the gap by the step. project: onto the cone of friction. p are the impulses; with a small R they are
those of rigid bodies. A body that slides floats by friction times slip in a step, a tenth of a millimetre here.
"""

from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

SOFTNESS = 1e-3
"""R, over what a unit impulse changes the velocity there."""
ITERATIONS = 40
TOLERANCE = 1e-6
"""m/s, rad/s: a body whose next step of Newton's method is smaller is solved."""
SHARES = (1.0, 0.5, 0.2, 0.05)
"""Shares of Newton's step that are tried; the one of least energy is taken."""
TINY = 1e-12


class BodyProblem(NamedTuple):
    """Energy of one step of many bodies, one a scene; contacts of all scenes in one list.

    mass_matrix: M, with the inertia in world axes. free: velocity if nothing touches. scene: of each contact. jacobian:
    velocity to d before the other surface's own. push: m. aim: w m plus the other surface's velocity. softness: R.
    """

    mass_matrix: Float[Tensor, "batch 6 6"]
    free: Float[Tensor, "batch 6"]
    scene: Int[Tensor, " contacts"]
    jacobian: Float[Tensor, "contacts 3 6"]
    push: Float[Tensor, "contacts 3"]
    aim: Float[Tensor, "contacts 3"]
    friction: Float[Tensor, " contacts"]
    softness: Float[Tensor, " contacts"]

    def take(self, scenes: Int[Tensor, " some"]) -> "BodyProblem":
        """The problem of some scenes."""
        number = torch.full_like(self.free[:, 0], -1, dtype=torch.long)
        number[scenes] = torch.arange(len(scenes), device=scenes.device)
        own = (number[self.scene] >= 0).nonzero().squeeze(-1)
        contacts = (values[own] for values in self[3:])
        return BodyProblem(self.mass_matrix[scenes], self.free[scenes], number[self.scene[own]], *contacts)

    def stretch(self, velocity: Float[Tensor, "*s batch 6"]) -> Float[Tensor, "*s contacts 3"]:
        """(w m - d) / R."""
        moved = (self.jacobian @ velocity[..., self.scene, :, None])[..., 0]
        return (self.aim - moved) / self.softness[:, None]

    def energy(self, velocity: Float[Tensor, "*s batch 6"]) -> Float[Tensor, "*s batch"]:
        """E."""
        off = velocity - self.free
        inertia = (off * (self.mass_matrix @ off[..., None])[..., 0]).sum(-1) / 2
        impulse = project(self.stretch(velocity), self.push, self.friction)
        each = self.softness * impulse.square().sum(-1) / 2
        return inertia.index_add(-1, self.scene, each)

    def gradient(self, velocity: Float[Tensor, "batch 6"]) -> Float[Tensor, "batch 6"]:
        """Of E."""
        impulse = project(self.stretch(velocity), self.push, self.friction)
        inertia = (self.mass_matrix @ (velocity - self.free)[..., None])[..., 0]
        return inertia.index_add(0, self.scene, -(self.jacobian.mT @ impulse[..., None])[..., 0])

    def curvature(self, velocity: Float[Tensor, "batch 6"]) -> Float[Tensor, "batch 6 6"]:
        """Second derivative of E, of a piece where it is made of pieces."""
        slope = _slope(self.stretch(velocity), self.push, self.friction) / self.softness[:, None, None]
        return self.mass_matrix.index_add(0, self.scene, self.jacobian.mT @ slope @ self.jacobian)


def project(
    stretch: Float[Tensor, "*s contacts 3"], push: Float[Tensor, "contacts 3"], friction: Float[Tensor, " contacts"]
) -> Float[Tensor, "*s contacts 3"]:
    """The impulse nearest to `stretch` that friction allows."""
    along = (stretch * push).sum(-1)
    across = stretch - along[..., None] * push
    length = across.norm(dim=-1)
    sliding = ((along + friction * length) / (1 + friction * friction)).clamp(min=0)
    slides = sliding[..., None] * (push + (friction / length.clamp(min=TINY))[..., None] * across)
    return torch.where((length <= friction * along)[..., None], stretch, slides)


def _slope(
    stretch: Float[Tensor, "contacts 3"], push: Float[Tensor, "contacts 3"], friction: Float[Tensor, " contacts"]
) -> Float[Tensor, "contacts 3 3"]:
    """Derivative of `project`."""
    along = (stretch * push).sum(-1)
    across = stretch - along[..., None] * push
    length = across.norm(dim=-1)
    way = across / length.clamp(min=TINY)[..., None]
    sliding = (along + friction * length) / (1 + friction * friction)
    ray = push + friction[..., None] * way
    identity = torch.eye(3, dtype=stretch.dtype, device=stretch.device)
    sideways = identity - push[:, :, None] * push[:, None, :] - way[:, :, None] * way[:, None, :]
    turning = (friction * sliding / length.clamp(min=TINY))[:, None, None] * sideways
    slides = ray[:, :, None] * ray[:, None, :] / (1 + friction * friction)[:, None, None] + turning
    slides = slides * (sliding > 0)[:, None, None]
    return torch.where((length <= friction * along)[:, None, None], identity, slides)


def solve_body(problem: BodyProblem, guess: Float[Tensor, "batch 6"]) -> Float[Tensor, "batch 6"]:
    """The velocities of least energy by Newton's method; differentiable in `free`."""
    with torch.no_grad():
        constant = BodyProblem(*(values.detach() for values in problem))
        velocity = _solve(constant, guess.detach())
    if not (torch.is_grad_enabled() and problem.free.requires_grad):
        return velocity
    # Where the gradient is zero, dv = H^-1 M d(free).
    curvature = constant.curvature(velocity)
    change = (constant.mass_matrix @ (problem.free - constant.free)[..., None])[..., 0]
    return velocity + torch.linalg.solve(curvature, change)


def _solve(problem: BodyProblem, velocity: Float[Tensor, "batch 6"]) -> Float[Tensor, "batch 6"]:
    touched = torch.zeros_like(velocity[:, 0], dtype=torch.bool).index_fill(0, problem.scene, True)
    solved, left = torch.where(touched[:, None], velocity, problem.free), touched.nonzero().squeeze(-1)
    problem, velocity = problem.take(left), velocity[left]
    shares = velocity.new_tensor(SHARES)[:, None, None]
    for _ in range(ITERATIONS):
        if not len(left):
            break
        step = -torch.linalg.solve(problem.curvature(velocity), problem.gradient(velocity))
        tried = velocity + shares * step
        best = problem.energy(tried).argmin(0)
        velocity = tried[best, torch.arange(len(best), device=best.device)]
        solved[left] = velocity
        open_ = (step.abs().amax(-1) > TOLERANCE).nonzero().squeeze(-1)
        if len(open_) < len(left):
            problem, velocity, left = problem.take(open_), velocity[open_], left[open_]
    return solved
