"""The process of the local Prefect server: `python -m prefect_robomaker.deployments.prefect_server --port PORT`.

It serves the home that `ROBOMAKER_HOME` names, and reads the home's secret itself, so that neither its command line
nor the environment it was started with holds it.
"""

import argparse
import os

from ...schemas.settings import Settings
from .secret import auth_string, server_folder


def main() -> None:
    """Serves until SIGTERM or SIGINT."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--port", type=int, required=True)
    port = parser.parse_args().port
    settings = Settings.from_environment(os.environ)
    secret = auth_string(settings)
    from .server_environment import server_variables

    # Prefect reads its settings when it is imported.
    os.environ.update(server_variables(server_folder(settings), port, secret))
    from .server_process import run

    run(port, secret)


if __name__ == "__main__":
    main()
