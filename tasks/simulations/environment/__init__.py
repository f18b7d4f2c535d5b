"""Environment of a run's programs: folders, variables, overlays of bundles, processors, memory, shared memory."""
