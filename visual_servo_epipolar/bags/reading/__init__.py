"""Reading: a bag of any kind, the topics of a run in it, and the run itself."""
