"""Nodes in processes of their own, their camera, an echo beside them, and what they cost."""
