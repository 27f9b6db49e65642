"""What is claimed of accuracy and speed, measured: ours and the peers in one run."""
