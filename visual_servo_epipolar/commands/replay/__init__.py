"""The subcommand ``replay``: its options, the run, settings by the user, its text."""
