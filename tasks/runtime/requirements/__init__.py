"""Requirements: the scene that rules measure in, and the observer that checks a run."""
