"""Disturbances: what the world does to an image or to features on their way to the sensor."""
