"""Applications that come with this package."""
