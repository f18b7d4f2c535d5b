"""Finding what people name on the command line."""
