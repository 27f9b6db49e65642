"""Evaluation: benchmarks, fault injection and reproduction of the paper; no robot needs it."""
