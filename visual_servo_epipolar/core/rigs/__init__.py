"""Rigs: a fixed mount or a head that carries the camera, behind one Protocol."""
