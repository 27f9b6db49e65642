"""Other laws behind the servo's own door: same images, same base, same judge."""
