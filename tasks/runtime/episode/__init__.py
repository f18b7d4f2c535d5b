"""Parts that all rooms of the runtime share: context, phases, verdicts, physics, its health, loading of factories."""
