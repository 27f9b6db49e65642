"""Two views of a camera that moves in the plane: motion, cameras, epipoles, rotation."""
