"""Recording benchmark: a recorder beside tracker and servo, as processes."""
