"""Applications that are container images: engines, command lines, outputs, cleanup."""
