"""Requirements on runs: the scene in which rules are measured, and the observer that checks them."""
