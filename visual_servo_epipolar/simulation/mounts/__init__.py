"""Camera rigs: where the camera sits on the robot, and what its sensor adds."""
