"""Requests and responses of the 57 operations, one module per resource, and the table of all operations."""
