"""The `robomaker` command."""
