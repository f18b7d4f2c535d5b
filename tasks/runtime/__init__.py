"""Runtime: code of the process that runs one simulation job, from loading the applications to its results."""
