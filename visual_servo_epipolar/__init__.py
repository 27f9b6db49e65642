"""Drive a unicycle robot to the pose from which a photograph was taken, by epipolar geometry."""

__version__ = '1.0.0'
