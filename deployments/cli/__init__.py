"""The `robomaker` command: words in, an answer on standard output and an exit code out.

`main.py` is the entry point, `grammar.py` the parser, `command_table.py` the table of commands, `arguments.py` the
arguments that several commands have. `commands/` has one module per command, `inputs/` finds what people name,
`output/` says things to people and programs, `probing/` forecasts runs. The other modules are the work behind commands:
`planning.py`, `job.py`, `serving.py`, `health.py`, `prefect_server.py`, `signals.py`.

May import everything below `deployments` and its neighbours `endpoint`, `worker`, `sdk`, `prefect_server`,
`dead_runs` and `access_keys`. At module level it imports nothing slow: neither Prefect nor MuJoCo, so that `--help`,
`validate`, `plan` and `schema` answer at once. Its modules are imported by name; the package itself has no names.
"""

__all__: list[str] = []
