"""Resource limits of a run and their measurement: processes, disk, logs."""
