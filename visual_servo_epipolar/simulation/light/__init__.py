"""Light: what falls on the surfaces of a room, and how an exposure follows it."""
