"""Which feature of the desired image is where in the current one; images stay in here."""
