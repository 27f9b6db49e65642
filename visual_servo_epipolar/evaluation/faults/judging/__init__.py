"""Judging: what happened in a run, by ground truth, and the verdict on it."""
