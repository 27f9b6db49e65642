"""Salvaging: what is left of a damaged storage file, written anew in its place."""
