"""Bases: what becomes of a command on the floor."""
