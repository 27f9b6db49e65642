"""Docking by a photograph: the dock's pose in metres, and requests to dock."""
