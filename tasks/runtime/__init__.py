"""Runtime: code of the processes that run one simulation job, from loading the applications to its results."""
