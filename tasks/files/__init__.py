"""Files that appear whole or not at all, and files in folders that others may have filled or that programs left."""
