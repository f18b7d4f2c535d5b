"""Look back at runs, repeat and remove them."""
