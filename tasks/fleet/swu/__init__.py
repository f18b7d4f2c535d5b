"""Bundles of ours as signed `.swu` files, which SWUpdate installs without change.

A `.swu` is a cpio archive: `sw-description`, which names the other files with their SHA-256, its detached signature,
and the files. `wrapping.py` makes one, the rest its parts. Needs the extra `fleet`.
"""
