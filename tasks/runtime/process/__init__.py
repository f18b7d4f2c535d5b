"""Process of a run: from a fork to `result.json`, with its simulation loop and its observers."""
