"""Parts that all operations share: base classes, names, ARNs, ids, errors, and saying what is wrong with a request."""
