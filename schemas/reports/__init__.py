"""Reports as data: a run's report and summary, comparison, history, the record of a run, and its progress."""
