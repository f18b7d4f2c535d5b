"""Robot and simulation applications that come with this package."""
