"""Bundle adjustment of the window: keyframes, features and what all views share, in one system."""
