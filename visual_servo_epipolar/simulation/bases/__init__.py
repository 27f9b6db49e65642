"""Bases: robots on the floor, behind one Protocol and by name in one table."""
