"""Videos of runs: recorded during a run, rendered after a failed run, and live on a web page."""
