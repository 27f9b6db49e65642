"""Replaying: a recorded run through the core once more, and how the two compare."""
