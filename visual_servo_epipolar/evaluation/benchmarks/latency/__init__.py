"""Latency from an image on the wire to the twist on the wire, beside an echo."""
