"""Many closed loops, on this machine or on a cluster: each follows from the plan and its index."""
