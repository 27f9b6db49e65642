"""The subcommand ``report``: one HTML page of a run folder or of a bag."""
