"""Cameras: one protocol for every lens, lenses beyond the pinhole, and checks of plausibility."""
