"""Phases: their table, the events that lead from one to another, the commands of each."""
