"""What people look at: figures and a video of a run. Reads a RunLog, imports core alone."""
