"""Motion: whether the base moves as commanded."""
