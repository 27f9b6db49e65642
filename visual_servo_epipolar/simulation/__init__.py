"""Simulation, never on a robot: the world, the base that drives in it, and disturbances."""
