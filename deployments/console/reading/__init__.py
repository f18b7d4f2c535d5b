"""Caches of the data that console pages read from large resources."""
