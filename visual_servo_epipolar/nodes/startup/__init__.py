"""Start of a node: its command line, its parameter files, its inputs; which nodes there are."""
