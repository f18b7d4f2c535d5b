"""Finding what people name on the command line: specification files, operations, earlier runs, worlds.

What is not there, or is something else, becomes one clear error here. May import schemas, and tasks where a catalog
has to be asked; prints nothing.
"""
