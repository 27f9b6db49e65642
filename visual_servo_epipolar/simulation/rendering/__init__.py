"""Pixels: the image of a room through a camera, sub-pixel exact."""
