"""Sandbox of a run's processes: Linux namespaces, or else Landlock rules of the kernel."""
