"""Resource limits of a run and their measurement: memory, processes, disk, logs."""
