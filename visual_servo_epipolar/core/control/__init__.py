"""The laws of the paper as pure functions, the table of laws, and gains."""
