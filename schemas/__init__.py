"""Data types of the service: requests and responses, states, errors, specifications; without any input or output."""
