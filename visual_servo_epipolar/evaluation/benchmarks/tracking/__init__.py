"""Tracking benchmark: the tracker on rendered approaches, against ground truth."""
