"""Arrivals: closed loops from the same starts, judged by ground truth."""
