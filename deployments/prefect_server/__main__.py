"""Entry point of the local Prefect server's process: `python -m prefect_robomaker.deployments.prefect_server`.

It serves the home that `ROBOMAKER_HOME` names, and reads the home's secret itself, so that neither its command line
nor the environment it was started with holds it. `--socket` is the number of an inherited socket that listens at
`--port` of 127.0.0.1; by its port the process is found again.
"""

import argparse
import gc
import os
import socket

from ...schemas.settings import Settings
from ..prefect_database import prepare_servers_database
from .secret import auth_string, server_folder


def main() -> None:
    """Runs the local Prefect server in this process, on the socket and port that the command line names.

    It sets the variables of the server in this process's environment, and prepares its database first.
    """
    parser = argparse.ArgumentParser()
    parser.add_argument("--port", type=int, required=True)
    parser.add_argument("--socket", type=int, required=True)
    arguments = parser.parse_args()
    # What is imported stays. Looking through it for rubbish again and again takes a seventh of the time to import it.
    gc.disable()
    listener = socket.socket(fileno=arguments.socket)
    listener.set_inheritable(False)
    settings = Settings.from_environment(os.environ)
    secret = auth_string(settings)
    from .secret import server_variables

    # Prefect reads its settings when it is imported.
    os.environ.update(server_variables(server_folder(settings), arguments.port, secret))
    prepare_servers_database(settings, os.environ)
    from .server_process import run

    gc.freeze()
    gc.enable()
    run(listener, secret)


if __name__ == "__main__":
    main()
