"""Catalogue of faults: each a row of a table, and what it does to a scene."""
