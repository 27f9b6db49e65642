"""Core, which runs on a robot: no ROS, no file, no clock, no global random state."""
