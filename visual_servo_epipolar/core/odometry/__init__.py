"""Odometry: commands sent, and the motion of the base by commands and by its wheels."""
