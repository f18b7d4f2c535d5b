"""systemd units for a user's own machine: Prefect server, Prefect worker, `robomaker serve`, and a nightly `gc`.

`installation` fills in the paths of the programs; the units contain no secrets, which are in a file of the user's own.
"""
