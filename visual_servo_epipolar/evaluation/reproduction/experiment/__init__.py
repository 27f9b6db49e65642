"""Experiment of the paper (section VIII): run, claims, figures, sensitivity."""
