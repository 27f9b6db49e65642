"""Lifecycle: shared by managed nodes; none acts or publishes unless it is active."""
