"""Applications that go wrong in every way."""
