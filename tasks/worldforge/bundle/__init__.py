"""World bundles: writing, reading, and the processes that build and draw them."""
