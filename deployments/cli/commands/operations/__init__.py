"""Call operations, look at worlds."""

__all__: list[str] = []
