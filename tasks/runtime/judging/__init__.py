"""ROS recordings as scenes in which requirements are measured: messages, topics, gaps."""
