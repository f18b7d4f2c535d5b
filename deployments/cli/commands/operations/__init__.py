"""Call operations, look at worlds."""
