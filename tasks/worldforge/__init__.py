"""WorldForge: generates furnished indoor worlds for simulation from a world template."""
