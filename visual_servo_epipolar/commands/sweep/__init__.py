"""The subcommand ``sweep``: its options, the sweep, and its progress."""
