# pyright: reportUnsupportedDunderAll=false
"""What needs memory and trusts nothing: TUF, downloads and archives, in a process that ends when it is done.

`python -m …child HOME` reads one request from standard input, and answers by lines of JSON.

May import: `tasks.fleet.agent`.
"""

__all__ = ["answers"]
