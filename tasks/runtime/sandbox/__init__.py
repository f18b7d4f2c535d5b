"""The box that a run's processes are in: namespaces of their own, or else rules of the kernel for files."""
