"""Environment variables of a job's processes: where programs are found, and how the service is reached."""

import os
import sys
from collections.abc import Mapping
from pathlib import Path
from urllib.parse import quote

from ....schemas.runs.variables import ENDPOINT_VARIABLE, OF_JOB
from ....schemas.settings import Settings
from .folders import TEMPORARY, Sandbox


def process_variables(
    sandbox: Sandbox, settings: Settings, environ: Mapping[str, str], caller: str = ""
) -> dict[str, str]:
    """The variables that every process of a run has, besides those that say what run it is and where its folders are.

    Args:
        sandbox: the run's folders.
        settings: the service's.
        environ: variables of this process.
        caller: see `service_variables`.
    """
    return {
        "TMPDIR": str(sandbox.place(TEMPORARY)),
        "PATH": search_path(environ),
        **service_variables(settings, environ, caller),
    }


def service_variables(settings: Settings, environ: Mapping[str, str], caller: str = "") -> dict[str, str]:
    """Returns the variables with which a job calls the service, about itself for example.

    The only secret among them is the job's own.

    SDKs get the endpoint where this process knows one, and placeholder keys where signatures are not checked. The
    command gets the home, unless the catalog is a database elsewhere, whose URL may hold a password.

    Args:
        settings: the service's.
        environ: variables of this process.
        caller: id and key of the job, with a slash between, by which the endpoint knows its calls.
    """
    variables = {"AWS_REGION": settings.region, "AWS_DEFAULT_REGION": settings.region}
    if endpoint := environ.get(ENDPOINT_VARIABLE):
        is_open = settings.access_keys_file is None
        variables[ENDPOINT_VARIABLE] = f"{endpoint.rstrip('/')}{OF_JOB}{caller}" if caller and is_open else endpoint
        if models := environ.get("AWS_DATA_PATH"):
            variables["AWS_DATA_PATH"] = models
        if is_open:
            variables |= {"AWS_ACCESS_KEY_ID": "local", "AWS_SECRET_ACCESS_KEY": "local"}
    if _keeps_catalog_at_home(settings):
        variables |= {
            "ROBOMAKER_HOME": str(settings.home),
            "ROBOMAKER_REGION": settings.region,
            "ROBOMAKER_ACCOUNT": settings.account,
        }
    return variables


def _keeps_catalog_at_home(settings: Settings) -> bool:
    plain = quote(str(settings.home), safe="/:@!$&'()*+,;=~")
    return settings.catalog_url in (f"sqlite:///{settings.home}/catalog.db", f"sqlite:///{plain}/catalog.db")


def search_path(environ: Mapping[str, str]) -> str:
    """Returns the path on which programs of jobs are found: beside this Python first, then the path of `environ`."""
    return os.pathsep.join([str(Path(sys.executable).parent), environ.get("PATH") or os.defpath])
