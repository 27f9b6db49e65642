"""Servo: from a measurement to a velocity, by a step-switching state machine and its state."""
