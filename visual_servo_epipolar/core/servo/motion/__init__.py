"""Motion: whether the base moves as it was told."""
