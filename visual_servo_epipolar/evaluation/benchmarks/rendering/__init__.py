"""Rendering benchmark: what an image of the simulated camera costs."""
