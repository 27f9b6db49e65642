"""Inputs of the servo: camera and wheels, and what their messages and stamps prove."""
