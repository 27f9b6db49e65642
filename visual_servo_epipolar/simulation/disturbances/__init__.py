"""Disturbances: light, shadow, occluders and motion between the scene and the sensor."""
