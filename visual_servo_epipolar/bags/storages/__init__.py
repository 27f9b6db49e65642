"""Storage files of bags, open for reading: mcap, sqlite3, ROS 1; nothing is written to them."""
