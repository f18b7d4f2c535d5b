"""Parts that all operations share: base classes, names, ARNs, ids, errors, and descriptions of request problems."""
