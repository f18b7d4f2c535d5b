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
    for name in ("PREFECT_API_URL", "PREFECT_API_AUTH_STRING", "PREFECT_API_KEY", "PREFECT_PROFILE"):
        os.environ.pop(name, None)  # the server is no client
    from .server_process import run

    run(port, secret)


if __name__ == "__main__":
    main()
