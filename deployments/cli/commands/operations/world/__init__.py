"""Look at generated worlds: show, view, sheet."""

__all__: list[str] = []
