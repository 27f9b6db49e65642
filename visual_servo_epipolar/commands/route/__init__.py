"""Routes on the command line: learnt from bags, taught and repeated in simulation."""
