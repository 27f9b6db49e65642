"""Real nodes in our hands: as processes, or in this process and in simulated time."""
