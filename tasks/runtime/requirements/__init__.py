"""Requirements: measurements, score, and the observer that checks a run against them."""
