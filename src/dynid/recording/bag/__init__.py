"""ROS 2 storage: messages out of SQLite and MCAP files, decoded and gathered."""
