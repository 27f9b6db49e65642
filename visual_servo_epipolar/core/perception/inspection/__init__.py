"""Inspection of two photographs: their geometry, and whether to trust it."""
