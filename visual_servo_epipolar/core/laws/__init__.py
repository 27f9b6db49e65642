"""Laws: their phases, events and commands, the equations, gains and departures of the paper."""
