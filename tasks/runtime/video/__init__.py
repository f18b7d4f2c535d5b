"""Video: recorded during a run, rendered after a failed run, and live on a page."""
