"""Files of the command line: cameras, photographs, scenarios, and the folder of a run."""
