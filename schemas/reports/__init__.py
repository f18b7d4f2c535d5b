"""Reports as data: the report, its summary, comparison and history, the record of a run and its progress."""
