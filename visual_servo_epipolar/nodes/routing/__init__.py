"""Parts of the route node: the recording of a way, its repetition, and reports of both."""
