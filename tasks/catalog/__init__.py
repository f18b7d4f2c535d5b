"""The catalog: every resource, its state, and the requests that made it."""
