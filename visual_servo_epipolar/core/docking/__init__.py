"""Docking by a photograph: where it was taken, in metres, and what a request to dock comes to."""
