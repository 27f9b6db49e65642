"""From a measurement to a velocity: the step-switching state machine and what it remembers."""
