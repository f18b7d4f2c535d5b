"""What `robomaker` prints."""
