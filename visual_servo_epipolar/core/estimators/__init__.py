"""Estimators of the two bearings from matches: one file each, one Protocol, chosen by name."""
