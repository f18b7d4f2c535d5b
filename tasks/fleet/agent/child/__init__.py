"""Child process for untrusted input: verifies TUF metadata, downloads and unpacks, then exits to free its memory.

`forking` makes it, `phases` says what it does; it answers by lines of JSON.
"""
