"""Prepare the object store for the roles of the roles file: init."""
