"""Control: the laws of the paper as pure functions, the table of laws, gains, settling time."""
