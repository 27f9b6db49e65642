"""One epipolar geometry of matches of which any may be wrong: in pixels, or of unit rays."""
