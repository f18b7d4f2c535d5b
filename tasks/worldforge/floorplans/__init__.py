"""Floor plans: rooms in a rectangle or set back from it, walls, ways between rooms, account of the preferences."""
