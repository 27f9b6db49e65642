"""What a memory of views is worth: against the bound, two views, and OpenCV on one structure."""
