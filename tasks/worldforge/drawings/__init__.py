"""Floor plans that people drew: reading them, and the worlds they become."""
