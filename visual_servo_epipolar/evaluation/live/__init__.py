"""Real nodes under test: as processes, or in this process and in simulated time."""
