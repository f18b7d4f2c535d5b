"""The furniture catalogue: kinds, styles, and the parts that each is built from."""
