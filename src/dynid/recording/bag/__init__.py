"""ROS storage: messages out of SQLite, MCAP and ROS 1 files, decoded and gathered."""
