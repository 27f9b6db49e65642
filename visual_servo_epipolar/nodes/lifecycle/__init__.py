"""Lifecycle: what managed nodes share; none does or says anything unless it is active."""
