"""Bags: recorded without decoding, repaired after a crash, replayed through the same core."""
