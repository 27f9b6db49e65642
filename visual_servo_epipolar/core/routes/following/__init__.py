"""Following: the taught path, by one image after the other."""
