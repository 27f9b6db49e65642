"""Wire: real nodes in one process and in simulated time, with every message in our hands."""
