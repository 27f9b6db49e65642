"""What never runs on a robot: the world, the base that drives in it, and what perturbs both."""
