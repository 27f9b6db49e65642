"""Bench of mounts: how well the robot arrives however its camera looks, and whatever its lens."""
