"""World generation and export jobs: the steps around WorldForge."""
