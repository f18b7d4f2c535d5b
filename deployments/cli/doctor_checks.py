"""The checks of `robomaker doctor`: what works on this machine, and how to fix what does not."""

import json
import os
import shutil
import stat
import subprocess
import sys
import time
import uuid
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Literal

from ...schemas.settings import Settings
from ...schemas.wings import parts_of_wings
from ...schemas.wire.errors import RobomakerError
from ...tasks.nights.missed_nights import has_schedules
from ..prefect_server.local_server import client_variables, server_status
from .prefect_server import described

Health = Literal["ok", "warning", "broken"]

_LITTLE_SPACE_BYTES = 2 * 1024**3
_LONGEST_WALK_S = 2.0
"""Time limit for measuring the data home, in seconds.

100,000 files take one second here, and people wait for `doctor`.
"""
_BYTES_OF_BLOCK = 512
"""Unit of `st_blocks` in bytes, whatever block size the file system has."""
_BYTES_THAT_COUNT = 500_000
_LARGEST = 3
_FALLING_BALL = """
from dm_control import mujoco
ball = '<body><freejoint/><geom size="0.1"/></body>'
physics = mujoco.Physics.from_xml_string(f'<mujoco><worldbody>{ball}</worldbody></mujoco>')
physics.step(10)
assert physics.data.qpos[2] < 0, f"a ball did not fall: {physics.data.qpos}"
"""
_MOST_MISSED = 7
"""Limit of the missed nights that `robomaker doctor` names: those of a week."""
_SHOWN_PACKAGES = ("prefect", "mujoco", "dm-control", "numpy", "pydantic", "sqlalchemy", "boto3")


@dataclass(frozen=True)
class Finding:
    """Result of one check of `robomaker doctor`: ok, warning or broken, with text."""

    subject: str
    health: Health
    found: str
    remedy: str = ""
    """Advice on how to fix a problem that `robomaker doctor` found; empty: nothing."""


def examine(settings: Settings, *, notify: bool = False) -> list[Finding]:
    """Runs all checks of `robomaker doctor`.

    Args:
        settings: The settings that are examined.
        notify: Whether a test message is sent to the addresses that are notified of the ends of runs.
    """
    without_roles = settings.model_copy(update={"roles_file": None})  # a wrong file is told once, and in its place
    checks: dict[str, Callable[[], Finding]] = {
        "python": check_python,
        "packages": check_packages,
        "physics": check_physics,
        "data home": lambda: check_home(settings.home, settings.min_free_disk_mb * 10**6),
        "catalog": lambda: check_catalog(without_roles),
        "object store": lambda: check_store(settings),
        "roles": lambda: check_roles(settings),
        "prefect server": lambda: check_server(settings),
        "video": check_video,
        "extras": check_extras,
        "containers": lambda: check_containers(without_roles),
        "sandbox": lambda: check_sandbox(settings),
        "left behind": lambda: check_left_behind(without_roles),
        "kept outputs": lambda: check_kept_outputs(without_roles),
        "kept archives": lambda: check_kept_archives(without_roles),
        "left jobs": lambda: check_left_jobs(settings, without_roles),
        "broken-off runs": lambda: check_broken_off(settings),
    }
    if has_schedules(settings.home) or _has_server(settings):
        checks["nights"] = lambda: check_nights(settings)
    if settings.notify or notify:
        checks["notifications"] = lambda: check_notifications(settings, notify=notify)
    for part in parts_of_wings("deployments", "doctor"):
        checks |= part.checks(without_roles)
    return [_examined(subject, check) for subject, check in checks.items()]


def _has_server(settings: Settings) -> bool:
    try:
        return server_status(settings).running
    except RobomakerError:  # the checks of data home and server say what is wrong
        return False


def _examined(subject: str, check: Callable[[], Finding]) -> Finding:
    try:
        return check()
    except RobomakerError as error:
        return Finding(subject, "broken", str(error))
    except OSError as error:
        return Finding(subject, "broken", f"{error.filename}: {error.strerror}" if error.filename else str(error))
    except Exception as error:
        # A broken installation can fail with any error; the other checks still have to run.
        return Finding(subject, "broken", f"{type(error).__name__}: {error}")


def check_python() -> Finding:
    """Checks the version of Python; broken if it is not 3.11 or 3.12."""
    version = ".".join(map(str, sys.version_info[:3]))
    if sys.version_info[:2] in ((3, 11), (3, 12)):
        return Finding("python", "ok", f"{version} ({sys.executable}), {os.cpu_count()} processors")
    return Finding("python", "broken", version, "use Python 3.11 or 3.12: dm_control has no packages for others")


def check_packages() -> Finding:
    """Checks that required packages are installed in working versions; broken if one is missing or does not fit."""
    from importlib.metadata import PackageNotFoundError, requires, version

    from packaging.requirements import Requirement

    from .version_conflicts import conflicts_among

    wrong = []
    for line in requires("prefect-robomaker") or []:
        requirement = Requirement(line)
        if requirement.marker and not requirement.marker.evaluate({"extra": ""}):
            continue  # of an extra that may be left out, or of other machines
        try:
            installed = version(requirement.name)
        except PackageNotFoundError:
            wrong.append(f"{requirement.name} is missing")
            continue
        if installed not in requirement.specifier:
            wrong.append(f"{requirement.name} is {installed}, not {requirement.specifier}")
    conflicts = list(conflicts_among(_version_of))
    if conflicts:
        remedies = " ".join(f"'{conflict.remedy}'" for conflict in conflicts)
        texts = "\n".join([*(conflict.text for conflict in conflicts), *wrong])
        return Finding("packages", "broken", texts, f"install what works together: pip install {remedies}")
    if wrong:
        return Finding("packages", "broken", "; ".join(wrong), "install again: uv sync --frozen")
    return Finding("packages", "ok", ", ".join(f"{name} {version(name)}" for name in _SHOWN_PACKAGES))


def _version_of(package: str) -> str | None:
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version(package)
    except PackageNotFoundError:
        return None


def check_physics() -> Finding:
    """Checks in a child process that MuJoCo and dm_control can simulate, and waits for it for 60 s at most."""
    answer = subprocess.run(
        [sys.executable, "-c", _FALLING_BALL],
        env={**os.environ, "MUJOCO_GL": "off"},
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    if answer.returncode == 0:
        return Finding("physics", "ok", "MuJoCo steps through dm_control")
    last = (answer.stderr.strip().splitlines() or [f"the process ended with {answer.returncode}"])[-1]
    return Finding("physics", "broken", last, "install again: uv sync --frozen")


def check_home(home: Path, least_free_bytes: int = 0) -> Finding:
    """Checks that the data home can be written to and has free space, and says what its folders take up.

    Args:
        home: The data home.
        least_free_bytes: Bytes that have to be free on the disk before a job begins.
    """
    probe = home / f".doctor-{uuid.uuid4().hex}"
    try:
        home.mkdir(0o700, parents=True, exist_ok=True)
        probe.write_bytes(b"probe")
        probe.unlink()
    except OSError as error:
        remedy = "set ROBOMAKER_HOME to a folder you can write to"
        return Finding("data home", "broken", f"{home}: {error.strerror}", remedy)
    free = shutil.disk_usage(home).free
    found = f"{home}, {_used_in_words(home, time.monotonic() + _LONGEST_WALK_S)}, {free / 1024**3:.1f} GiB free"
    if free < least_free_bytes:
        remedy = (
            f"free {(least_free_bytes - free) / 1e6:.0f} MB: no job begins below ROBOMAKER_MIN_FREE_DISK_MB, which is "
            f"{least_free_bytes / 1e6:.0f}; robomaker gc removes old runs"
        )
        return Finding("data home", "broken", found, remedy)
    if free < _LITTLE_SPACE_BYTES:
        return Finding("data home", "warning", found, "worlds and recordings may fill it; free some space")
    if home.stat().st_mode & stat.S_IRWXO:
        words = f"open to all users of this machine ({stat.filemode(home.stat().st_mode)})"
        return Finding(
            "data home", "warning", f"{found}; {words}", f"chmod o-rwx {home}, unless others are to look into it"
        )
    return Finding("data home", "ok", found)


def _used_in_words(home: Path, until_s: float) -> str:
    """Describes the disk space of a data home and of its largest folders: `23 MB (objects 15 MB, prefect 7 MB)`.

    Args:
        home: The data home.
        until_s: Time limit on the monotonic clock; a size that is not known by then is called `at least`.
    """
    sizes: dict[str, int] = {}
    for entry in sorted(home.iterdir()):
        folders = [entry]
        while folders and time.monotonic() < until_s:
            with suppress(OSError):  # it was removed meanwhile, or cannot be read
                folder = folders.pop()
                if folder.is_symlink() or not folder.is_dir():
                    sizes[entry.name] = sizes.get(entry.name, 0) + folder.lstat().st_blocks * _BYTES_OF_BLOCK
                else:
                    folders += folder.iterdir()
    largest = sorted(sizes.items(), key=lambda item: -item[1])[:_LARGEST]
    parts = ", ".join(f"{name} {size / 1e6:,.0f} MB" for name, size in largest if size >= _BYTES_THAT_COUNT)
    least = "at least " if time.monotonic() >= until_s else ""
    return f"{least}{sum(sizes.values()) / 1e6:,.0f} MB{f' ({parts})' if parts else ''}"


def check_catalog(settings: Settings) -> Finding:
    """Checks that the catalog's database can be opened; an error of it is raised, not returned."""
    from ...tasks.service.service import Service

    Service.open(settings).catalog.close()
    shown = settings.catalog_url.split("@")[-1]  # not the password
    return Finding("catalog", "ok", shown)


def check_store(settings: Settings) -> Finding:
    """Checks that objects can be written, read and deleted in the object store; creates its bucket if that is missing.

    An error of the store is raised, not returned.
    """
    from ...tasks.storage import open_store

    store = open_store(settings, os.environ)
    key = f".doctor/{uuid.uuid4().hex}"
    store.ensure_bucket(settings.bucket)
    store.put_bytes(settings.bucket, key, b"probe")
    try:
        content = store.get_bytes(settings.bucket, key)
    finally:
        store.delete(settings.bucket, key)
    if content != b"probe":
        return Finding("object store", "broken", f"{settings.object_store} gives back other bytes than were put")
    return Finding("object store", "ok", f"{settings.object_store}, bucket {settings.bucket}: put, get, delete work")


def check_roles(settings: Settings) -> Finding:
    """Checks the roles file, which gives simulation jobs their access rights; a warning if a role lacks credentials.

    Raises an error if the file cannot be read; without a roles file all is well.
    """
    from ...tasks.storage.roles import read_roles_file

    if settings.roles_file is None:
        found = "no ROBOMAKER_ROLES_FILE: `iamRole` is recorded only, all jobs have the rights of their job worker"
        return Finding("roles", "ok", found)
    roles = read_roles_file(settings.roles_file)
    is_folder = settings.object_store != "aws" and "://" not in settings.object_store
    lacking = [role.arn for role in roles if not role.has_source and not is_folder]
    found = f"{len(roles)} in {settings.roles_file}; jobs with any other role fail"
    if lacking:
        return Finding(
            "roles", "warning", f"{found}; without credentials: {', '.join(lacking)}", "`robomaker storage init`"
        )
    return Finding("roles", "ok", found)


def check_server(settings: Settings) -> Finding:
    """Checks the Prefect server that runs on this machine would use; broken if a configured one does not answer."""
    status = server_status(settings)
    if status.configured_elsewhere and not status.running:
        remedy = "start that server, or unset PREFECT_API_URL to use a local one"
        return Finding("prefect server", "broken", described(status), remedy)
    return Finding("prefect server", "ok", described(status))


def check_video() -> Finding:
    """Checks which backends can render videos; a warning if only the slow one that needs no packages can."""
    from ...tasks.runtime.rendering.backends import available_video_backends

    backends = available_video_backends()
    working = [backend.name for backend in backends if backend.works]
    if any(backend.works and backend.packages for backend in backends):
        return Finding("video", "ok", ", ".join(working))
    # Without OpenGL the slow ray caster is left; it needs no packages.
    missing = "; ".join(f"{backend.name}: {backend.problem}" for backend in backends if not backend.works)
    packages = next(backend.packages for backend in backends if not backend.works)
    remedy = f"for fast video: apt install --no-install-recommends {' '.join(packages)}"
    return Finding("video", "warning", f"{', '.join(working) or 'none'} ({missing})", remedy)


def check_extras() -> Finding:
    """Lists which facilities that only some jobs need are here and which are missing; always `ok`.

    They are a container engine, ROS, a GPU, and the extras of this package.
    """
    from ...schemas.extras import extras, how_to_install
    from ...tasks.simulations.containers.engines import find_engine
    from ...tasks.simulations.environment.run_environment import has_gpu

    there: list[str] = []
    missing: list[str] = []
    try:
        there.append(f"container images by {find_engine(os.environ, shutil.which).program}")
    except RobomakerError as error:
        missing.append(str(error))
    launchers = [name for name in ("roslaunch", "ros2") if shutil.which(name)]
    if launchers:
        there.append(f"ROS launch files by {' and '.join(launchers)}")
    else:
        missing.append("ROS launch files: neither roslaunch nor ros2 is on the path")
    (there if has_gpu() else missing).append("a GPU for jobs that ask for one")
    of_package = extras()
    lacking = [name for name, is_installed in of_package.items() if not is_installed]
    if installed := [_extra_in_words(name) for name in of_package if name not in lacking]:
        there.append(f"extras {', '.join(installed)}")
    if lacking:
        named = ", ".join(map(_extra_in_words, lacking))
        missing.append(f"extras {named}; the first is added by: {how_to_install(lacking[0])}")
    return Finding("extras", "ok", "\n".join([f"there: {'; '.join(there)}", *(f"missing: {each}" for each in missing)]))


def _extra_in_words(name: str) -> str:
    return f"{name} (bridge to ROS 2 by cyclonedds)" if name == "ros" else name


def check_containers(settings: Settings) -> Finding:
    """Checks for containers left behind by job workers that died; warns of their runs, and removes nothing."""
    from ...tasks.jobs.job_folders import abandoned_runs
    from ...tasks.service.service import Service

    with Service.opened(settings) as service:
        left = [str(run) for run, _ in abandoned_runs(service)]
    if left:
        remedy = "start any simulation job here, which removes them; the engine has to answer"
        return Finding("containers", "warning", "\n".join(("runs whose job worker died left some:", *left)), remedy)
    return Finding("containers", "ok", "no run that is over has left any")


def check_sandbox(settings: Settings) -> Finding:
    """Checks in a child process whether simulation jobs can be sandboxed on this machine; a warning if not fully."""
    from ...tasks.runtime.sandbox.levels import Confinement
    from ...tasks.runtime.supervision.run_requests import plan_box

    command = [sys.executable, "-P", "-m", "prefect_robomaker.tasks.runtime.sandbox.levels"]
    tried = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    confinement = Confinement(**json.loads(tried.stdout))
    lacks: list[str] = []
    box = plan_box(settings, confinement, warn=lacks.append)
    told = {"box": "jobs are in boxes of their own", "landlock": "jobs reach only their own files (Landlock)"}
    found = told.get(box.level, "jobs are not confined")
    if settings.sandbox == "off":
        return Finding(
            "sandbox", "ok", f"off: {found}, as ROBOMAKER_SANDBOX says; this machine has {confinement.level}"
        )
    found += f"; network: {box.network}"
    found += (
        "; without access keys `serve` takes what a job's processes ask for as that job's own"
        if settings.access_keys_file is None
        else "; `serve` takes signed requests only, and jobs have no access key"
    )
    if confinement.why_not_more:
        remedy = "allow user namespaces (docs/sandbox.md)"
        return Finding("sandbox", "warning", f"{found}\n{confinement.why_not_more}", remedy)
    return Finding("sandbox", "ok", found)


def check_left_behind(settings: Settings) -> Finding:
    """Checks for folders and limits left behind by processes that died; warns of each, and removes nothing."""
    from ...tasks.jobs.job_folders import overtaken_runs
    from ...tasks.runtime.process.rehearsal_folders import abandoned_folders
    from ...tasks.service.service import Service
    from ..flow_run_history import collect_limits

    with Service.opened(settings) as service:
        left = [f"{run}: its job was taken over, and has ended" for run, _ in overtaken_runs(service)]
        left += [
            f"the concurrency limit {name}: its batch has ended"
            for name in collect_limits(settings, service, act=False)
        ]
    left += [f"{folder}: the job worker that rehearsed there was killed" for folder in abandoned_folders()]
    if left:
        return Finding(
            "left behind", "warning", "\n".join(left), "`robomaker gc`, and job workers that start, remove them"
        )
    return Finding("left behind", "ok", "nothing of processes that died or lost their jobs")


def check_kept_outputs(settings: Settings) -> Finding:
    """Checks for outputs that could not be uploaded and are on this machine only; names their folders in a warning."""
    from ...tasks.jobs.job_folders import find_kept
    from ...tasks.service.service import Service

    with Service.opened(settings) as service:
        kept = [str(run.output_dir) for run in find_kept(service)]
    if kept:
        found = "\n".join(("outputs that could not be stored are here only:", *kept))
        return Finding("kept outputs", "warning", found, "`robomaker upload --kept` stores them")
    return Finding("kept outputs", "ok", "all outputs of jobs that have ended are stored")


def check_kept_archives(settings: Settings) -> Finding:
    """Tells how many archives of applications are kept for `repro`, and their size."""
    from ...tasks.reporting.outcomes import size
    from ...tasks.service.service import Service
    from ...tasks.simulations.inputs.kept_archives import kept_archives

    with Service.opened(settings) as service:
        sizes = [each.size_bytes for each in kept_archives(service)]
    archives = f"{len(sizes)} {'archive' if len(sizes) == 1 else 'archives'} of applications"
    if not sizes:
        return Finding(
            "kept archives", "ok", "no archives of applications are kept; jobs that run keep theirs for repro"
        )
    told = f"{archives}, {size(sum(sizes))}, are kept for repro; `robomaker gc` removes those that no job names"
    return Finding("kept archives", "ok", told)


def check_left_jobs(settings: Settings, opened_with: Settings) -> Finding:
    """Checks for unfinished jobs that no process will continue by itself.

    Args:
        settings: Settings that the jobs' needs are compared with.
        opened_with: Settings that the catalog is opened with.
    """
    from ...tasks.jobs.job_owners import left_jobs
    from ...tasks.service.service import Service

    with Service.opened(opened_with) as service:
        left = left_jobs(replace(service, settings=settings))
    if not left:
        return Finding("left jobs", "ok", "every job that was begun has a process that carries it out")
    found = [f"{job.arn} was {standing.in_words()}" for job, standing in left]
    commands = [f"on {standing.machine}: {standing.command}" for _, standing in left]
    return Finding("left jobs", "warning", "\n".join(found), "\n".join(commands))


def check_broken_off(settings: Settings) -> Finding:
    """Checks for interrupted runs, and says what finishes them."""
    from ...tasks.nights.broken_off import broken_off_runs

    found = broken_off_runs(settings)
    if not found:
        return Finding("broken-off runs", "ok", "every run that began has ended, or has a process that carries it out")
    left = [run for run in found if run.why_left]
    remedies = [f"{run.place}{run.command}" for run in left]
    if len(left) < len(found):
        remedies.append("start robomaker serve or a Prefect worker, which finishes them")
    return Finding("broken-off runs", "warning", "\n".join(run.in_words() for run in found), "\n".join(remedies))


def check_nights(settings: Settings) -> Finding:
    """Checks whether the scheduled runs of the last week happened, and whether the next ones can.

    It is broken if the Prefect server does not run. Sets the server's variables in this process's environment, and
    sends notifications of nights that were newly found missed.
    """
    from ...tasks.nights.missed_nights import schedules_of

    status = server_status(settings)
    if not status.running:
        return Finding("nights", "broken", "the Prefect server does not run: no night begins", "robomaker server start")
    os.environ.update(client_variables(str(status.api_url), settings))
    from ..missed_nights import look_for_missed_nights, without_worker

    look_for_missed_nights(settings)
    if not has_schedules(settings.home):
        return Finding("nights", "ok", "no deployment of this data home has a schedule")
    week = datetime.now(UTC) - timedelta(days=7)
    found = [
        f"{each.name}: {night.in_words()}"
        for each in schedules_of(settings.home)
        for night in each.missed
        if night.due_at > week
    ]
    found += broken_nights(settings, week)
    paused = [f"{each.name}: its schedule is paused" for each in schedules_of(settings.home) if each.paused_since]
    pools = without_worker(settings)
    waits = [f"{name}: no Prefect worker of the pool {pool} is running" for name, pool in pools]
    if found or paused or waits:
        remedies = [f"prefect worker start --pool {pool}" for pool in dict.fromkeys(pool for _, pool in pools)]
        remedies += ["prefect deployment schedule ls RunPipeline/NAME, then resume"] if paused else []
        return Finding("nights", "warning", "\n".join([*waits, *paused, *found[-_MOST_MISSED:]]), "\n".join(remedies))
    return Finding("nights", "ok", "all nights of the last week happened, and a Prefect worker waits for the next")


def broken_nights(settings: Settings, since: datetime) -> list[str]:
    """Describes runs of scheduled specifications that broke since a time for a reason that no job has.

    An example: `nightly: refused on 27 November (02:00 UTC): REASON`, or `nightly: broken on …: step worlds: REASON`.
    """
    from ...tasks.inspection.run_records import find_records
    from ...tasks.nights.missed_nights import schedules_of

    names = dict.fromkeys(each.name for each in schedules_of(settings.home))
    return [
        f"{name}: {'refused' if run.refusal else 'broken'} on {run.started_at.day} {run.started_at:%B} "
        f"({run.started_at:%H:%M} UTC): {why.splitlines()[0]}"
        for name in names
        for run in find_records(settings.home / "runs", name, _MOST_MISSED).records
        if (why := run.refusal or run.step_error) and run.started_at > since
    ]


def check_notifications(settings: Settings, *, notify: bool) -> Finding:
    """Checks the notification channels, by a test message if `notify` is true; broken if none or a wrong one is set."""
    from ...tasks.notifications.notification_texts import Message
    from ...tasks.notifications.sending import send, unknown_channels

    channels = settings.notify
    if not channels:
        remedy = "set ROBOMAKER_NOTIFY to addresses such as json://host/path or mailtos://…"
        return Finding("notifications", "broken", "no message says how runs ended", remedy)
    when = ", ".join(sorted(settings.notify_when))
    if notify:
        body = "Robomaker's doctor sent this to see whether you can be told how runs end."
        problems = send(channels, Message("robomaker: a test", body, good=True), {})
    else:
        problems = unknown_channels(channels)
    if problems:
        remedy = "mend ROBOMAKER_NOTIFY; github.com/caronc/apprise says what addresses look like"
        return Finding("notifications", "broken", "\n".join(problems), remedy)
    told = "took a test message" if notify else "known, not tried: `robomaker doctor --notify` sends a test message"
    return Finding("notifications", "ok", f"channels: {len(channels)}, {told}; told of: {when}")
