"""Settings of Prefect that the local server runs with."""

from pathlib import Path

# Slots held by a process that was killed come back also when the server was killed with it.
_LEASE_STORAGE = "prefect.server.concurrency.lease_storage.filesystem"


def server_variables(folder: Path, port: int, auth_string: str) -> dict[str, str]:
    """The environment variables of the server's process.

    Args:
        folder: where the server keeps its database.
        port: port of 127.0.0.1 that it listens at.
        auth_string: what every request has to carry, `user:secret`.
    """
    return {
        "PREFECT_HOME": str(folder),
        # The port alone does not reach the pages, which would look for their API at port 4200.
        "PREFECT_SERVER_API_HOST": "127.0.0.1",
        "PREFECT_SERVER_API_PORT": str(port),
        "PREFECT_SERVER_UI_API_URL": f"http://127.0.0.1:{port}/api",
        "PREFECT_SERVER_API_AUTH_STRING": auth_string,
        "PREFECT_SERVER_CSRF_PROTECTION_ENABLED": "true",
        "PREFECT_SERVER_CORS_ALLOWED_ORIGINS": f"http://127.0.0.1:{port}",
        "PREFECT_SERVER_ANALYTICS_ENABLED": "false",
        "PREFECT_SERVER_UI_SHOW_PROMOTIONAL_CONTENT": "false",
        "PREFECT_SERVER_CONCURRENCY_LEASE_STORAGE": _LEASE_STORAGE,
    }
