"""A sweep as a map of its starts, and as a table by law."""
