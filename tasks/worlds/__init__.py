"""World generation and export jobs: building worlds in processes, storing them, and packing exports."""
