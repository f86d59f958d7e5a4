"""Learning from a real robot's pushes: physical unknowns first, then a small correction."""
