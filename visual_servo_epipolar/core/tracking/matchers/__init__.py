"""Matchers: which points of a photograph an image shows, wherever it was taken; a registry."""
