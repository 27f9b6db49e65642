"""Fusion: two views and the map of keyframes become one measurement."""
