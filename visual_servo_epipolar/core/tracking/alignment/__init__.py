"""Alignment of features with their templates in the desired image; it knows no other frame."""
