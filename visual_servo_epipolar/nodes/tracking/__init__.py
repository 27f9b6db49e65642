"""Parts of the tracker node: its photograph, its images, its lateness."""
