"""Odometry: what was commanded, and how far the base has moved by commands and by its wheels."""
