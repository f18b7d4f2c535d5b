"""The page of a specification's history, and words about what changed since when."""
