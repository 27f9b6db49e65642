"""Photographs of one pose: captured at rest, tied to the first one, kept by their light."""
