"""Shared parts of the runtime's subpackages: context, phases, verdicts, physics, health, import of factories."""
