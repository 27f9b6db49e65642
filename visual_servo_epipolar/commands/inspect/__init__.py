"""The subcommand ``inspect``: its options, and what two photographs say."""
