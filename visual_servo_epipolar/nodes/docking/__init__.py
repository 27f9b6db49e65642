"""Docking over ROS: the action server, the servo as its client, commands turned round."""
