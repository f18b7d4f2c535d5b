"""Child process for untrusted input: verifies TUF metadata, downloads and unpacks, then exits to free its memory.

`forking` starts it, `phases` has its work; it answers by lines of JSON.
"""
