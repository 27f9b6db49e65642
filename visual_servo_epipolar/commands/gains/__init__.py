"""The subcommand ``gains``: its options, and what is derived from them."""
