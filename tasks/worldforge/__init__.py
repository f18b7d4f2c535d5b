"""WorldForge: furnished indoor worlds from a template body."""
