"""From tracked features to a measurement of the goal that has passed the validation gates."""
