"""Let robots in, and look at them: enroll, list."""

__all__: list[str] = []
