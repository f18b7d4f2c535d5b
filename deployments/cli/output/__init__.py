"""Output of commands: responses, problems, progress, summaries, facts of worlds, and opening a browser.

Takes data and a stream, and decides nothing about exit codes. May import schemas, the types of `inputs`, and rich,
which is imported when something is printed with it; no command.
"""
