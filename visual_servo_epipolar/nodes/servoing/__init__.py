"""Parts of the servo node: its camera, its command, its reports, and what may stop the robot."""
