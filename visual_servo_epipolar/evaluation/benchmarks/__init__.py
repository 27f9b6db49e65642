"""Benchmarks: accuracy and speed, ours and the peers' in one run."""
