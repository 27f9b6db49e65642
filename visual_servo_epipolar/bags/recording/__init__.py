"""Recording: serialized messages into a rosbag2 folder that survives a crash."""
