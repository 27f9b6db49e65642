"""Recording in the nodes: which topics are recorded, and their subscriptions as bytes."""
