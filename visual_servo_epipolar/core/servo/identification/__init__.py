"""Identification: what driving shows of the base, and of the camera on it."""
