"""Alignment of features with their templates in the desired image alone."""
