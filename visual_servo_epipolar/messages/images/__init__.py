"""Images: grey levels of what drivers send raw and compressed, and of picture files."""
