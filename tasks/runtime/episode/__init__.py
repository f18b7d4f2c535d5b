"""Parts that all rooms of the runtime share: context, phases, verdicts, physics, health, import of factories."""
