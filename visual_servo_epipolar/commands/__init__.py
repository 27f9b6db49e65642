"""The command line: one module a subcommand of ``visual_servo``."""
