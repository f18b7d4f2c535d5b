"""The process of an ordered run, `python -m prefect_robomaker.deployments.cli.ordered_run LOCK`; its input: the order.

The lock on the file LOCK is held for as long as this process lives; that is how servers know that the run goes on.
"""

import os
import signal
import sys
import threading
import time
from pathlib import Path

from ....schemas.reports.progress import Note
from ....schemas.settings import Settings
from ....schemas.specs.check import load_spec
from ....schemas.wire.errors import ConfigurationError, RobomakerError, SpecError
from ...endpoint.calling.access_keys import AccessKey, read_access_keys
from ...endpoint.calling.audit_log import AuditLog
from ...spec_runs.kept_answers import ANSWERS, KeptAnswers
from ...spec_runs.orders import Order
from ...spec_runs.standing import CANCEL, LOCK, ORDER, StandingFile, read_standing
from ..prefect_server import use_server, wait_for_server_once
from ..signals import interrupted_by_signals

NICENESS = 5
"""As job workers: the server comes first."""

_LOOK_S = 0.5


def main() -> None:
    """Carries out the order."""
    os.set_inheritable(int(sys.argv[1]), False)
    os.nice(NICENESS)
    order = Order.model_validate_json(sys.stdin.buffer.read())
    settings = Settings.from_environment(os.environ)
    folder = settings.home / "runs" / order.run_id
    standing = read_standing(folder)
    if standing is None:
        raise ConfigurationError(f"{folder} is the folder of no run that was ordered")
    listener = StandingFile(folder, standing)
    try:
        with interrupted_by_signals():
            threading.Thread(target=_watch, args=(folder / CANCEL,), daemon=True).start()
            _carry_out(order, settings, listener)
    except SpecError as error:
        listener.broke("\n".join(map(str, error.problems)))
    except RobomakerError as error:
        listener.broke(str(error))
    except KeyboardInterrupt:
        listener.broke("it was cancelled")  # of one that had begun there is a record, which says so, too
    finally:
        listener.write()
        for name in (ANSWERS, ORDER, LOCK):  # without the last it is not taken up again
            (folder / name).unlink(missing_ok=True)


def _carry_out(order: Order, settings: Settings, listener: StandingFile) -> None:
    api_url = use_server(settings)
    # Imported when it is known which server of Prefect's is used.
    from ....flows.pipelines import run_spec
    from ....tasks.service.service import Service
    from ...spec_runs.rights import Permits

    wait_for_server_once(api_url, settings, lambda text: listener(Note(text)))
    service = Service.open(settings)
    audit_log = AuditLog(order.audit_log, service.clock) if order.audit_log else None
    run_spec(
        load_spec(order.text, order.filename),
        settings,
        listener,
        spec_path=order.spec_path,
        command=order.command,
        rerun_of=order.rerun_of,
        run_id=order.run_id,
        permit=KeptAnswers(
            settings.home / "runs" / order.run_id, Permits(_key(order, settings), order.address, audit_log, service)
        ),
    )


def _key(order: Order, settings: Settings) -> AccessKey | None:
    """The visitor's access key, as it is now.

    Raises:
        ConfigurationError: it is not there any more.
    """
    if order.key_id is None:
        return None
    keys = read_access_keys(settings.access_keys_file) if settings.access_keys_file else {}
    if order.key_id not in keys:
        raise ConfigurationError("the access key that ordered this run is not there any more")
    return keys[order.key_id]


def _watch(cancel: Path) -> None:
    """Ends the run once a server asks for it, as Ctrl-C would."""
    while not cancel.exists():
        time.sleep(_LOOK_S)
    os.kill(os.getpid(), signal.SIGTERM)


if __name__ == "__main__":
    main()
