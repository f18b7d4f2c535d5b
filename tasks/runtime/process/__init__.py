"""The process of a run: from a fork to `result.json`, with its loop and its observers."""
