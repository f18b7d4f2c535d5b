"""The agent of a robot: enroll, run, status."""

__all__: list[str] = []
