"""Phases: their table, what leads from one to another, and what each commands."""
