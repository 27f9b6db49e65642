"""What belongs to the tracker's node: its photograph, its images, how late it is."""
