"""What runs on a robot: geometry, tracking, laws. No ROS, no file, no clock, no global chance."""
