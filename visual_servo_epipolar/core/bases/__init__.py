"""Bases: what a robot's base can follow, behind one Protocol; a base is one file and one row."""
