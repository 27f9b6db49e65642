"""Routes on disk."""
