"""Predictors that several tests use."""

import torch
from torch import nn

from pushgraph.network.dynamics import ContactDynamics
from pushgraph.physics import PhysicsPredictor


def drawn_correction() -> PhysicsPredictor:
    """Weights that were drawn, so that what holds of it holds by construction."""
    torch.manual_seed(0)
    dynamics = ContactDynamics(hidden=24, steps=2).eval().requires_grad_(False)
    for layer in (dynamics.network.of_edge, dynamics.network.of_node):
        nn.init.normal_(layer.weight, std=0.05)
        nn.init.normal_(layer.bias, std=0.05)
    return PhysicsPredictor(dynamics)


def no_correction() -> PhysicsPredictor:
    """The laws alone."""
    return PhysicsPredictor(ContactDynamics().eval().requires_grad_(False))
