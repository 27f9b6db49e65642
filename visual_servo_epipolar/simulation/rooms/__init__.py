"""Rooms: what stands where, of which material, and where in it a robot can stand."""
