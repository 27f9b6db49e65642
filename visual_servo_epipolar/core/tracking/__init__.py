"""Tracking: the features of the desired image in each current one; no image leaves this layer."""
