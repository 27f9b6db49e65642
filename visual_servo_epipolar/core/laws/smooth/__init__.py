"""Law ``smooth``: one motion to the goal by its two oriented bearings, without steps."""
