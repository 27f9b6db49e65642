"""Simulations and experiment of the paper, run again: its figures, and a table of its claims."""
