"""The commands of `robomaker`: one module each, named like its command; a command that has commands is a folder.

A group is a folder whose docstring is the heading of its commands in the help; it is no word of the command line.

A command's module has three things: a docstring, which is its help (the first line is its summary), `declare`, which
adds its arguments to a parser, and `execute`, which does the work and returns the exit code. `grammar.py` finds it by
its file; nothing else has to know it. It is imported when it is chosen, also for its help and for a misspelt
option, so it imports at its top what is quick, and inside `execute` what is not: pydantic's models, rich, the tasks.

May import what is beside this folder, but for `main` and `grammar`; no other command.
"""
