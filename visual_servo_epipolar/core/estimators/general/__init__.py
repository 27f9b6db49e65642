"""General motion of a camera in the hand: found, refined, with the deviation of its bearings."""
