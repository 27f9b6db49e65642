"""Estimate: the goal's pose by all images of the way, and models of base and camera."""
