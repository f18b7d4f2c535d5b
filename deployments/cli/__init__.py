"""The `robomaker` command: words in, an answer on standard output and an exit code out.

`main.py` is the entry point, `grammar.py` the parser with the table of commands, `arguments.py` the arguments that
several commands have. `commands/` has one module per command, `inputs/` finds what people name, `output/` says things
to people and programs. The other modules are the work behind commands: `planning.py`, `probes.py`, `job.py`,
`serving.py`, `health.py`, `prefect_server.py`, `signals.py`.

May import everything below `deployments` and its neighbours `endpoint`, `worker`, `service_model`,
`prefect_server` and `dead_run_sweeper`. At module level it imports nothing slow: neither Prefect nor MuJoCo, so that
`--help`, `validate`, `plan` and `schema` answer at once. Its modules are imported by name; the package itself has no
names.
"""
