"""Floor plans of worlds: rooms, walls, doorways and windows, and the outcome of the template's preferences."""
