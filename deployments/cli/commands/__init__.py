"""The commands of `robomaker`: one module each, named like its command; a folder is a command that has commands.

A command's module has three things: a docstring, which is its help (the first line is its summary), `declare`, which
adds its arguments to a parser, and `execute`, which does the work and returns the exit code. `command_table.py` finds
it by its file; nothing else has to know it. It is imported when it is chosen, so it may import at its top what it
needs, but for Prefect, MuJoCo and the engines, which `execute` imports when it gets there.

May import `arguments`, `inputs`, `output`, `job`, `prefect_server` and `health`; no other command.
"""

__all__: list[str] = []
