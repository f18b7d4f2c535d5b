"""Look back at runs, repeat and remove them."""

__all__: list[str] = []
