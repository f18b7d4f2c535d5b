# pyright: reportUnsupportedDunderAll=false
"""What needs memory and trusts nothing: TUF, downloads and archives, in a process that ends when it is done.

`forking` makes it, `phases` says what it does; it answers by lines of JSON.

May import: `tasks.fleet.agent`.
"""

__all__ = ["answers", "forking", "phases"]
