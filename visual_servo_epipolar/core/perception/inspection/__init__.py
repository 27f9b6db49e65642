"""Inspection of two photographs: what they tell, and whether to believe it."""
