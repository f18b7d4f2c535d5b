"""Consistency check: compares the catalog with the object store, and repairs some defects."""
