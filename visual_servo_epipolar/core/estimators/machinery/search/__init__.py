"""Search of a geometry of which nothing is known, or nothing that fits."""
