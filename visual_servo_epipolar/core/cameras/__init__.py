"""Cameras: what is asked of every lens, those that are no pinholes, and what no lens can be."""
