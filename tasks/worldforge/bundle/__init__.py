"""World bundles: writing, reading, proving, and the processes that build and draw them."""
