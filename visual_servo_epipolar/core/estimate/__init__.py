"""Estimate: where the goal is by all images of the way, and what base and camera are like."""
