"""The only place that reads or fills message fields."""
