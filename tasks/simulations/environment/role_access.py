"""Access of a job's code to the object store as the job's role, with credentials that are renewed."""

import json
import logging
import threading
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from pathlib import Path, PurePath
from typing import Any
from urllib.parse import urlsplit

from ....schemas.settings import Settings
from ....schemas.wire.errors import LaunchError, RobomakerError, StorageAccessDeniedError
from ...files.whole_files import write_whole
from ...service.service import Service
from ...storage.roles import Keys
from .aws_endpoints import DATA_VARIABLE, container_data_path, endpoint_variables, store_server
from .folders import AWS, Sandbox
from .run_environment import run_sandbox

_CONFIG, _CONTAINER_CONFIG, _KEYS, _S3CFG = "config", "container.config", "keys.json", "s3cfg"
_PLACEHOLDERS = ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY")


def role_of(request: Mapping[str, Any]) -> str | None:
    """Returns the ARN of the access role that a job request names; `None` if it names none."""
    return request.get("iamRole")


def acting_service(request: Mapping[str, Any], service: Service) -> Service:
    """Returns the service with the object-store access of the role that a request names.

    Raises:
        LaunchError: The role does not exist, or its credentials are refused.
        StorageUnavailableError: The store does not answer.
    """
    try:
        return service.acting_as(role_of(request))
    except StorageAccessDeniedError as error:
        raise LaunchError(f"iamRole: {error}", "BadPermissionsUserCredentials") from error


def store_variables(request: Mapping[str, Any], sandbox: Sandbox, service: Service) -> dict[str, str]:
    """Makes the variables that name AWS config files with the address of the object store's S3 server, for a job.

    Returns none if the store has no S3 server and the request no role with credentials. The files are not written here.

    Args:
        request: Request of the job.
        sandbox: Folders of the run.
        service: The service, with its catalog and object store.

    Raises:
        LaunchError: The role has no credentials.
    """
    endpoint, keys = store_server(service.settings), role_keys(request, service)
    if endpoint is None and keys is None:
        return {}
    folder = sandbox.place(AWS)
    variables = {"AWS_CONFIG_FILE": str(folder / _CONFIG)}
    if endpoint is not None:
        variables["S3CMD_CONFIG"] = str(folder / _S3CFG)
    return variables


def access_variables(
    variables: Mapping[str, str],
    request: Mapping[str, Any],
    sandbox: Sandbox,
    service: Service,
    environ: Mapping[str, str],
) -> dict[str, str]:
    """Returns variables by which AWS SDKs in a job find this service, and act as the job's role, besides the run's own.

    The files that the variables name are written. Placeholder credentials for clients of the service are removed if the
    role has credentials, as SDKs would use them for the object store.

    Args:
        variables: Environment variables of the run.
        request: Request of the job.
        sandbox: Folders of the run.
        service: The service, with its catalog and object store.
        environ: Environment variables of this process.

    Raises:
        LaunchError: The role has no credentials.
        StorageUnavailableError: The server does not answer.
    """
    keys, store = role_keys(request, service), store_variables(request, sandbox, service)
    if store:
        write_store_files(sandbox, service.settings, keys)
    has_keys = keys is not None
    endpoints = endpoint_variables(variables, role_of(request), sandbox, service, environ, has_role_keys=has_keys)
    kept = {name: value for name, value in variables.items() if not (has_keys and name in _PLACEHOLDERS)}
    return {**kept, **store, **endpoints}


def container_variables(variables: Mapping[str, str]) -> dict[str, str]:
    """Returns the AWS variables of a job with the paths that their files have in a container."""
    places = {"AWS_CONFIG_FILE": _CONTAINER_CONFIG, "S3CMD_CONFIG": _S3CFG}
    found = {name: value for name, value in variables.items() if name.startswith("AWS_") and name != DATA_VARIABLE}
    found |= {name: f"{AWS}/{file}" for name, file in places.items() if name in variables}
    return found | container_data_path(variables)


def role_keys(request: Mapping[str, Any], service: Service) -> Keys | None:
    """Returns the current credentials of the role that a request names; `None` if there are none.

    Raises:
        LaunchError: The role exists, but provides no credentials.
        StorageUnavailableError: The server does not answer.
    """
    role = role_of(request)
    if service.roles is None or role is None:
        return None
    try:
        return service.roles.keys_of(role)
    except StorageAccessDeniedError as error:
        raise LaunchError(f"iamRole: {error}", "BadPermissionsUserCredentials") from error


def write_store_files(sandbox: Sandbox, settings: Settings, keys: Keys | None) -> None:
    """Writes the config and credentials files for the object store in a run's folder, each atomically.

    Any user of a container may read them; other users of this machine cannot reach the folder. Without keys, the files
    have only its server and region.
    """
    folder, endpoint = sandbox.place(AWS), store_server(settings)
    folder.mkdir(parents=True, exist_ok=True)
    folder.parent.chmod(0o700)
    if keys is not None:
        _write(folder / _KEYS, json.dumps(_process_answer(keys), indent=1))
    for name, seen_at in ((_CONFIG, folder), (_CONTAINER_CONFIG, PurePath(AWS))):
        _write(folder / name, _config(settings, seen_at, keys, path_style=endpoint is not None))
    if endpoint is not None:
        _write(folder / _S3CFG, _s3cfg(endpoint, settings.region, keys))


def _config(settings: Settings, folder: PurePath, keys: Keys | None, *, path_style: bool) -> str:
    lines = ["[default]", f"region = {settings.region}"]
    if keys is not None and keys.expires_at is None:
        lines += [f"aws_access_key_id = {keys.access_key_id}", f"aws_secret_access_key = {keys.secret_access_key}"]
        lines += [f"aws_session_token = {keys.session_token}"] if keys.session_token else []
    elif keys is not None:
        lines.append(f'credential_process = cat "{folder / _KEYS}"')
    if path_style:
        lines += ["s3 =", "    addressing_style = path"]
    return "\n".join([*lines, ""])


def _process_answer(keys: Keys) -> dict[str, Any]:
    """Returns credentials in the form that AWS clients expect as JSON output of a `credential_process`."""
    answer: dict[str, Any] = {
        "Version": 1,
        "AccessKeyId": keys.access_key_id,
        "SecretAccessKey": keys.secret_access_key,
    }
    if keys.session_token:
        answer["SessionToken"] = keys.session_token
    return answer | ({"Expiration": keys.expires_at.isoformat()} if keys.expires_at else {})


def _s3cfg(endpoint: str, region: str, keys: Keys | None) -> str:
    parts = urlsplit(endpoint)
    lines = ["[default]", f"host_base = {parts.netloc}", f"host_bucket = {parts.netloc}", f"bucket_location = {region}"]
    lines.append(f"use_https = {parts.scheme == 'https'}")
    if keys is not None:
        lines += [f"access_key = {keys.access_key_id}", f"secret_key = {keys.secret_access_key}"]
        lines += [f"access_token = {keys.session_token}"] if keys.session_token else []
    return "\n".join([*lines, ""])


def _write(path: Path, text: str) -> None:
    """Writes text to a file atomically, as a program may be reading it; creates its folder if necessary."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, text)


EVERY_S = 60.0
"""Seconds between two checks; credentials of an assumed role are renewed after half of their lifetime, which is at
least 15 minutes.
"""

_logger = logging.getLogger(__name__)


@contextmanager
def fresh_keys(request: Mapping[str, Any], service: Service, folder: Path, every_s: float = EVERY_S) -> Generator[None]:
    """Writes the files of a role's credentials, and keeps them up to date in a thread inside the `with` block.

    Does nothing without a role. If credentials cannot be renewed, that is logged.

    Args:
        request: Request of the job.
        service: The service, with its catalog and object store.
        folder: Folder of the run.
        every_s: Seconds between two checks whether the credentials have changed.

    Raises:
        LaunchError: The role gives no credentials.
        StorageUnavailableError: The server does not answer.
    """
    keys = role_keys(request, service)
    if keys is None:
        yield
        return
    sandbox, over = run_sandbox(folder), threading.Event()
    write_store_files(sandbox, service.settings, keys)
    if keys.expires_at is None:
        yield
        return

    def look() -> None:
        last = keys
        while not over.wait(every_s):
            try:
                now = role_keys(request, service)
                if now is not None and now != last:
                    write_store_files(sandbox, service.settings, now)
                    last = now
            except (RobomakerError, OSError) as error:  # those that are there may be good for a while
                _logger.warning("the credentials of %s cannot be had again: %s", request.get("iamRole"), error)

    thread = threading.Thread(target=look, name="fresh-keys", daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
