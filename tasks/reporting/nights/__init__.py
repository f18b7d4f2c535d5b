"""HTML page of a specification's history over its runs, and texts about changes between runs."""
