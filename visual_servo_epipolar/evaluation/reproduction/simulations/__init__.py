"""Simulations 1 and 2 of the paper (section VII): runs, claims, figures."""
