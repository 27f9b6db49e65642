"""Rigs: what carries the camera, a fixed mount or a head, behind one Protocol."""
