"""Calibrations as other programs write them: what their files say, checked key by key."""
