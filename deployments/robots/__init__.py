"""Robots at `robomaker serve`: the door beside the endpoint, on orders and files of catalog and store."""
