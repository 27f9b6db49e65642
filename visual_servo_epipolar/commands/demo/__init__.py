"""The subcommand ``demo``: its options, and the four nodes in lockstep."""
