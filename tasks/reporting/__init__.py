"""Reports of pipeline runs."""
