"""Units of systemd for a user's own machine: Prefect server, Prefect worker, `robomaker serve`, and a nightly `gc`.

`installation` fills in where the programs are; the units have no secrets, which are in a file of the user's own.
"""
