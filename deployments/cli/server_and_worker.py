"""Runs `robomaker serve`: the endpoint for SDKs, and a job worker beside it that runs their jobs."""

import argparse
import json
import logging
import os
import signal
import socket
import sys
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...schemas.settings import Settings
from ...schemas.wings import parts_of_wings
from ...schemas.wire.errors import ConfigurationError
from ...tasks.service.data_home import prepare_home
from ..endpoint.calling.access_keys import AccessKey, read_access_keys
from ..endpoint.origins import is_loopback
from ..endpoint.server import TlsFiles
from ..log_lines import log_formatter
from ..service_model.installation import data_path
from ..worker.worker_process import WorkerProcess, in_words
from .output.answers import open_address
from .prefect_server import pages, use_server

if TYPE_CHECKING:
    from ...tasks.nights.broken_off import BrokenOff


def serve(arguments: argparse.Namespace) -> int:
    """Runs the API server, web console and job worker until a signal stops them; returns 0.

    A Prefect server is started if jobs are executed here and none runs. Raises ConfigurationError if the port is
    taken, or if others could reach the server and there are no access keys.
    """
    settings = Settings.from_environment(os.environ)
    max_jobs = _max_jobs(arguments.max_jobs, settings)
    _log_to_stderr()
    access_keys = read_access_keys(settings.access_keys_file) if settings.access_keys_file else None
    if access_keys is None and not is_loopback(arguments.host):
        raise ConfigurationError(
            f"--host is {arguments.host!r}, which others can reach, and every client can run programs here; "
            "set ROBOMAKER_ACCESS_KEYS_FILE to a file of access keys first (docs/serving.md)"
        )
    tls = TlsFiles.checked(arguments.tls_certificate, arguments.tls_key)
    _check_port(arguments.host, arguments.port)
    prefect_url = None if arguments.execute_jobs == "none" else use_server(settings).removesuffix("/api")
    about = {
        "execute": arguments.execute_jobs,
        "max_jobs": max_jobs,
        "backend": settings.backend,
        "prefect_url": prefect_url,
    }
    _end_on_hang_up()
    _serve(arguments, settings, access_keys, tls, about)
    return 0


def _serve(
    arguments: argparse.Namespace,
    settings: Settings,
    access_keys: Mapping[str, AccessKey] | None,
    tls: TlsFiles | None,
    about: dict[str, Any],
) -> None:
    if arguments.execute_jobs == "none":
        _run_server(arguments, settings, access_keys, tls, about)
        return
    prepare_home(settings)
    variables = {**_variables_of_jobs(arguments), "ROBOMAKER_MAX_JOBS": str(about["max_jobs"])}
    worker = WorkerProcess(settings, variables)
    worker.start()
    try:
        _run_server(arguments, settings, access_keys, tls, about, worker, variables)
    except KeyboardInterrupt:
        worker.kill()
        raise
    except BaseException:
        worker.stop()
        raise
    _stop(worker)


def _run_server(
    arguments: argparse.Namespace,
    settings: Settings,
    access_keys: Mapping[str, AccessKey] | None,
    tls: TlsFiles | None,
    about: dict[str, Any],
    worker: WorkerProcess | None = None,
    variables: Mapping[str, str] | None = None,
) -> None:
    # Imported late, while the worker already starts.
    from ...tasks.nights.taking_up import TakingUp
    from ...tasks.reporting.console_pages import forget_console, note_console
    from ...tasks.service.service import Service
    from ..console.console import Console
    from ..console.rendering import HOME
    from ..endpoint.application import Endpoint, write_access_log
    from ..endpoint.calling.audit_log import AuditLog
    from ..endpoint.server import run_server
    from ..spec_runs.spec_runs import SpecRuns

    if arguments.log_requests:
        write_access_log()
    service = Service.open(settings)

    def tell(arn: str) -> None:
        if worker is not None:
            worker.wake(arn)
        for each in beside:
            each.wake()

    def worker_status() -> Mapping[str, object]:
        return {"state": "elsewhere"} if worker is None else worker.status()

    log_path = Path(arguments.audit_log).absolute() if arguments.audit_log else None
    audit_log = AuditLog(log_path, service.clock) if log_path else None
    spec_runs = None if variables is None else SpecRuns(settings.home, variables, log_path)
    endpoint = Endpoint(
        service,
        access_keys=access_keys,
        on_submitted=tell,
        worker_status=worker_status,
        audit_log=audit_log,
        console=HOME,
    )
    console = Console(endpoint, service, access_keys=access_keys, worker_status=worker_status, spec_runs=spec_runs)
    application, beside = console, list[Any]()
    for part in parts_of_wings("deployments", "serving"):
        application = part.beside(application, service)
        beside.append(application)

    def announce(port: int) -> None:
        url = _url(arguments, port)
        facts = {"url": url, "console_url": f"{url}{HOME}", "pid": os.getpid(), **about}
        _announce(facts, settings, signed=access_keys is not None, form=arguments.output)
        note_console(settings.home, facts["console_url"], facts["prefect_url"])
        if variables is not None:
            look_for_missed = partial(_look_for_missed, settings)
            TakingUp(settings, variables, tell=_tell_of_left, look_for_missed=look_for_missed).start()
        if arguments.open:
            open_address(facts["console_url"])

    try:
        run_server(
            application,
            arguments.host,
            arguments.port,
            ready=announce,
            stopping=console.end_streams,
            tls=tls,
            proxies=[str(each) for each in settings.trusted_proxies],
        )
    finally:
        forget_console(settings.home)


def _tell_of_left(run: "BrokenOff") -> None:
    # Imports Prefect, which this process does not need otherwise.
    from ...tasks.nights.run_orders import tell_of_left

    tell_of_left(run)


def _look_for_missed(settings: Settings) -> None:
    # Imports Prefect, which this process does not need otherwise; called again after minutes.
    from ..missed_nights import look_for_missed_nights

    look_for_missed_nights(settings)


def _variables_of_jobs(arguments: argparse.Namespace) -> dict[str, str]:
    """Returns the variables with which an SDK in a job finds this endpoint, and knows the service.

    A port that is chosen when the server begins to listen is not known yet.
    """
    if not arguments.port:
        return {}
    return {"AWS_ENDPOINT_URL_ROBOMAKER": _url(arguments, arguments.port), "AWS_DATA_PATH": data_path(os.environ)}


def _stop(worker: WorkerProcess) -> None:
    """Stops the job worker, waits for it, and prints which jobs were interrupted; a second Ctrl-C kills it at once."""
    try:
        interrupted = worker.stop()
    except KeyboardInterrupt:
        worker.kill()
        raise
    if interrupted:
        sys.stderr.write(f"Interrupted: {in_words(interrupted)}; the next `robomaker serve` goes on with them.\n")


def _announce(facts: dict[str, Any], settings: Settings, *, signed: bool, form: str) -> None:
    """Prints the endpoint's URL and the environment variables for using it, as text or JSON, on standard output."""
    region = settings.region
    variables = {"AWS_ENDPOINT_URL_ROBOMAKER": facts["url"], "AWS_REGION": region, "AWS_DEFAULT_REGION": region}
    if not signed:
        # SDKs insist on signing; the endpoint does not check the signature here.
        variables |= {"AWS_ACCESS_KEY_ID": "local", "AWS_SECRET_ACCESS_KEY": "local"}
    if form == "json":
        sys.stdout.write(json.dumps({"schema_version": 1, **facts, "environment": variables}) + "\n")
    else:
        sys.stdout.write("\n".join(_lines(facts, variables, signed=signed)) + "\n")
    sys.stdout.flush()


def _lines(facts: Mapping[str, Any], variables: Mapping[str, str], *, signed: bool) -> list[str]:
    lines = [f"RoboMaker answers at {facts['url']} until you press Ctrl-C.", f"Its console: {facts['console_url']}"]
    lines += ["", "In another terminal:", ""]
    lines += [f"  export {name}={value}" for name, value in variables.items()]
    lines += ['  eval "$(robomaker sdk-model)"    # for SDKs that do not know RoboMaker any more']
    if signed:
        lines += ["", "Clients have to sign with one of the access keys in ROBOMAKER_ACCESS_KEYS_FILE."]
    if facts["execute"] == "here":
        shown_at = pages(f"{facts['prefect_url']}/api", os.environ.get("PREFECT_API_AUTH_STRING"))
        batches = "" if facts["backend"] == "local" else f", those of batches on {facts['backend']}"
        last = f"Jobs are performed here, {facts['max_jobs']} at a time{batches}; {shown_at} shows them."
    else:
        last = "Jobs wait for a job worker: `robomaker perform ARN`, or a `robomaker serve` elsewhere."
    return [*lines, "", last, ""]


def _max_jobs(given: int | None, settings: Settings) -> int:
    if given is not None and not 1 <= given <= 9999:
        raise ConfigurationError(f"--max-jobs is {given}; it has to be a number from 1 to 9999")
    return settings.max_jobs if given is None else given


def _check_port(host: str, port: int) -> None:
    """Checks that the server's port is free, before anything is started.

    Raises ConfigurationError if it is taken or is no number from 0 to 65535; 0 means any that is free.
    """
    if not 0 <= port <= 65535:
        raise ConfigurationError(f"--port is {port}; it has to be a number from 1 to 65535, or 0 for any that is free")
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family) as probe:
        # Connections of the last server that are still closing do not make its port a taken one.
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError as error:
            raise ConfigurationError(
                f"cannot listen at {host} port {port}: {error.strerror or error}; choose another with --port or --host"
            ) from error


def _url(arguments: argparse.Namespace, port: int) -> str:
    """Builds the URL at which clients on this machine reach the server."""
    host = str(arguments.host)
    scheme = "http" if arguments.tls_certificate is None else "https"
    name = {"0.0.0.0": "127.0.0.1", "::": "[::1]"}.get(host, f"[{host}]" if ":" in host else host)  # noqa: S104 - is told apart
    return f"{scheme}://{name}:{port}"


def _end_on_hang_up() -> None:
    """Makes a closed terminal (SIGHUP) end the server like Ctrl-C, unless nohup ignores the signal."""
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        signal.signal(signal.SIGHUP, lambda *_: os.kill(os.getpid(), signal.SIGTERM))


def _log_to_stderr() -> None:
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(log_formatter(os.environ, "%(asctime)s %(message)s", "%H:%M:%S"))
    for name in ("prefect_robomaker", "robomaker.endpoint"):
        logger = logging.getLogger(name)
        logger.handlers = [handler]
        logger.setLevel(logging.INFO)
        logger.propagate = False
