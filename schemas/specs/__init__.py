"""Specifications: YAML text, references and their types, every check before a run, and the JSON Schema."""
