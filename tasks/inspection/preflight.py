"""Checks before a pipeline's first step, so that mistakes are reported before worlds are generated."""

import shutil
import socket
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import cache
from typing import Any

from ...schemas.reports.names import short_name
from ...schemas.runs.requirement_kinds.goal import goals_at_start
from ...schemas.runs.requirements import no_such_room, starts_on_origin
from ...schemas.specs.checking.written_requests import (
    WORLD,
    WrittenRequest,
    asked_rooms,
    is_sound,
    text_with,
    written_requests,
)
from ...schemas.specs.specification import CheckedSpec, CheckedStep
from ...schemas.specs.yaml_nodes import plain, value_place
from ...schemas.wire.errors import (
    BucketNotFoundError,
    ObjectNotFoundError,
    Problem,
    SpecError,
    StorageAccessDeniedError,
    StorageError,
    StorageUnavailableError,
)
from ...schemas.wire.request_problems import Location, nearest, path_text
from ..service.service import Service
from ..service.store_retries import patiently
from ..service.world_names import with_worlds_found
from ..simulations.inputs.bundles import Rooms, rooms_of_world
from ..simulations.outputs.output_places import DEFAULT_PREFIX, prepare_bucket
from ..storage.object_store import ObjectStore, check_key, check_prefix, join_key
from ..worlds.generation import WORLDS_PREFIX
from .forecasting import find_forecast

RoomsOf = Callable[[str], Rooms | None]
"""Function that returns the rooms of a world by ARN; None if they are unknown."""

_KINDS = {"robotApplications": "robot-application", "simulationApplications": "simulation-application"}
_TEMPLATE = "world-template"


def await_store(service: Service, note: Callable[[str], None]) -> None:
    """Waits until the object store answers, and immediately tells the user if it does not.

    Args:
        service: Service, whose settings have the time limit.
        note: Called with messages: that the store is awaited, for how long, and that it answers again.

    Raises:
        StorageError: The store's address names no host, which waiting does not mend.
        StorageUnavailableError: The object store did not answer within the time.
    """
    bucket, patience_s = service.settings.bucket, service.timing.store_patience_s

    def probe() -> None:
        try:
            service.store.probe(bucket)
        except StorageUnavailableError as error:
            if _names_no_host(error):
                raise StorageError(f"{error}: there is no such host; check ROBOMAKER_OBJECT_STORE") from error
            raise

    try:
        probe()
    except StorageUnavailableError as error:
        most = f"at most {patience_s / 60.0:.3g} min (ROBOMAKER_STORE_PATIENCE_MIN)"
        note(f"the object store does not answer; the run waits for it, {most}; Ctrl-C ends the wait: {error}")
        patiently(service.patient("the run", lambda: False).store, bucket, probe)
        note("the object store answers")


def _names_no_host(error: BaseException | None) -> bool:
    """Returns whether an error came from a host that does not exist, not from an unreachable server or network."""
    while error is not None:
        if isinstance(error, socket.gaierror):
            return error.errno == socket.EAI_NONAME
        error = error.__cause__ or error.__context__
    return False


def check_disk(checked: CheckedSpec, service: Service) -> None:
    """Checks that the outputs forecast for a run fit on the disk of a local object store.

    Raises:
        StorageError: The disk has too little space; a disk that fills up in the night ends the run, or stops it until a
            person frees space.
    """
    forecast = find_forecast(checked, service.settings)
    place = service.store.local_path(service.settings.bucket, "any")
    if forecast is None or place is None:
        return
    root = next(folder for folder in place.parents if folder.exists())
    if (free := shutil.disk_usage(root).free) < forecast.size_bytes:
        raise StorageError(
            f"the outputs will take {forecast.size_bytes / 1e9:.1f} GB by the forecast of {forecast.made_at:%Y-%m-%d}, "
            f"and {free / 1e9:.1f} GB are free on the disk of {root}: robomaker gc removes old runs, and "
            "robomaker plan --probe makes a newer forecast"
        )


def check_preconditions(checked: CheckedSpec, service: Service) -> None:
    """Checks before a run that object store and backend answer, and that named applications, objects and rooms exist.

    To check the run's own credentials, a few bytes are written to the store and deleted.

    Raises:
        SpecError: An application or an object of the store is named that does not exist, or a goal is in a room that
            its world has not, or where its robot starts; says where and what is near.
        StorageError: The object store cannot be used.
        BackendError: The machines that are to run the jobs cannot be reached.
    """
    if service.backend is not None:
        service.backend.check()
    prepare_bucket(service, service.settings.bucket)
    _check_writable(checked, service)
    check_named(checked, service)
    if missing := missing_objects(checked, service.store):
        raise SpecError(missing)
    check_rooms(checked, service)


def check_rooms(checked: CheckedSpec, service: Service) -> None:
    """Checks that the rooms which jobs' requirements name are in the worlds that these jobs name, if those exist.

    Raises:
        SpecError: A goal is in a room that its world has not, or where its robot starts; says where.
        StorageError: The object store cannot be used.
    """
    rooms_of = cache(lambda arn: _rooms(arn, service))
    if problems := [problem for step in checked.steps.values() for problem in _room_problems(step, rooms_of)]:
        raise SpecError(problems)


def check_named(checked: CheckedSpec, service: Service) -> None:
    """Checks that the applications which a specification's jobs name exist in the catalog.

    Applications that a step of the same specification creates count as existing.

    Raises:
        SpecError: An application does not exist; the message says in which step, and names the most similar one.
    """
    made = {
        (f"{step.operation.removeprefix('Create').removesuffix('Application').lower()}-application", name)
        for step in checked.steps.values()
        if step.operation.endswith("Application") and isinstance(name := plain(step.input).get("name"), str)
    }
    is_stored = cache(lambda kind, name: service.catalog.find(kind, name) is not None)
    problems = []
    for step in checked.steps.values():
        for at, kind, name in _named(plain(step.input), ()):
            if (kind, name) not in made and not is_stored(kind, name):
                known = {there for made_kind, there in made if made_kind == kind}
                known |= {resource.name for resource in service.catalog.list(kind).resources}
                words = f"there is no {kind.replace('-', ' ')} {name!r}{nearest(name, sorted(known))}"
                problems.append(_problem(step, at, words))
    if problems:
        raise SpecError(problems)


def with_all_found(checked: CheckedSpec, service: Service) -> CheckedSpec:
    """Returns a specification with the ARNs of its worlds, after all names of worlds and applications were looked up.

    Raises:
        SpecError: Worlds or applications do not exist; with all of them, in the order of the file.
    """
    problems: list[Problem] = []
    found = checked
    try:
        found = with_worlds_found(checked, service)
    except SpecError as error:
        problems += error.problems
    try:
        check_named(checked, service)
    except SpecError as error:
        problems += error.problems
    if problems:
        raise SpecError(sorted(problems, key=lambda each: (each.place.line, each.place.column)), checked.notes)
    return found


def names_any(checked: CheckedSpec) -> bool:
    """Returns whether a specification's jobs name applications or worlds, which a run looks up in the catalog."""
    steps = checked.steps.values()
    return any(step.worlds for step in steps) or any(any(_named(plain(step.input), ())) for step in steps)


def missing_objects(checked: CheckedSpec, store: ObjectStore) -> list[Problem]:
    """Returns a problem for each object that a specification's steps name and that the object store does not have.

    Such objects are archives of applications, bodies of templates and data of jobs, as far as they are known before the
    run. Objects below a place that a step of the specification writes to are not looked for, nor those that may not be
    read with these credentials: the step, or a job with its own role, says whether they are there.

    Raises:
        StorageError: The store does not answer.
    """
    written = [place for step in checked.steps.values() for place in _written(plain(step.input))]
    is_there = cache(lambda bucket, key, is_prefix: _is_there(store, bucket, key, is_prefix=is_prefix))
    problems: list[Problem] = []
    for step in checked.steps.values():
        for at, bucket, key in _objects(plain(step.input), ()):
            if any(bucket == there and key.startswith(prefix) for there, prefix in written):
                continue
            try:
                (check_prefix if "s3Keys" in at else check_key)(key)
            except StorageError as error:  # of the key, before the store is asked
                problems.append(_problem(step, at, str(error)))
                continue
            if not is_there(bucket, key, "s3Keys" in at):
                problems.append(_problem(step, at, f"there is no object 's3://{bucket}/{key}' in the object store"))
    return problems


def _is_there(store: ObjectStore, bucket: str, key: str, *, is_prefix: bool) -> bool:
    """Whether an object exists, or one whose key begins so; true if it cannot be told."""
    try:
        if is_prefix:
            return next(iter(store.list(bucket, key)), None) is not None
        store.head(bucket, key)
    except StorageAccessDeniedError:
        return True
    except (BucketNotFoundError, ObjectNotFoundError):
        return False
    return True


def check_templates(checked: CheckedSpec, service: Service) -> None:
    """Checks that the world templates that a specification's steps name exist in the catalog.

    Raises:
        SpecError: A world template does not exist; the message says in which step.
    """
    problems = []
    for step in checked.steps.values():
        template = plain(step.input).get("template") if step.operation == "CreateWorldGenerationJob" else None
        if not isinstance(template, str) or "${{" in template:
            continue
        found = service.catalog.get_many([template]).get(template)
        if found is None or found.kind != _TEMPLATE:
            words = f"there is no world template {template!r}"
            problems.append(_problem(step, ("template",), words))
    if problems:
        raise SpecError(problems)


def _check_writable(checked: CheckedSpec, service: Service) -> None:
    """Checks that the destinations of the run's worlds and outputs are writable with the run's credentials.

    Raises:
        SpecError: A job's output location names a bucket that is not there or cannot be written to.
        StorageError: The configured bucket cannot be written to.
    """
    own = service.settings.bucket
    places: dict[str, tuple[str, Problem | None]] = {}
    for step in checked.steps.values():
        request = plain(step.input)
        if step.operation == "CreateWorldGenerationJob":
            places.setdefault(own, (WORLDS_PREFIX, None))
        for at, order in _orders(request, ()):
            location = order.get("outputLocation")
            given = location if isinstance(location, Mapping) else {}
            bucket, prefix = given.get("s3Bucket") or own, given.get("s3Prefix", "") if given else DEFAULT_PREFIX
            has_role = service.roles is not None and order.get("iamRole") is not None
            if not has_role and isinstance(bucket, str) and isinstance(prefix, str) and "${{" not in bucket + prefix:
                problem = None if bucket == own else _problem(step, (*at, "outputLocation", "s3Bucket"), "")
                places.setdefault(bucket, (prefix, problem))
    problems: list[Problem] = []
    for bucket, (prefix, problem) in places.items():
        try:
            if problem is not None:
                prepare_bucket(service, bucket)
            service.store.check_writable(bucket, join_key(prefix, "preflight"))
        except (BucketNotFoundError, StorageAccessDeniedError) as error:
            if problem is None:
                raise
            problems.append(replace(problem, message=str(error)))
    if problems:
        raise SpecError(problems)


def _rooms(arn: str, service: Service) -> Rooms | None:
    world = service.catalog.get_many([arn]).get(arn)
    return None if world is None else rooms_of_world(world, service)


def _room_problems(step: CheckedStep, rooms_of: RoomsOf) -> Iterator[Problem]:
    """Yields problems of goals in rooms that existing worlds do not have, or in which the robot starts.

    Jobs in worlds that are not known before the run are not checked.
    """
    for request in written_requests(step):
        told: dict[Location, str] = {}
        for scope, world in request.values(WORLD) if is_sound(request) else ():
            rooms = rooms_of(world) if world.startswith("arn:") else None
            if rooms is not None:
                which = f"; the world is {short_name(world)}" if scope else ""  # which one of several
                for at, words in _wrong_rooms(request, rooms, scope):
                    told.setdefault(at, f"{words}{which}")
        for at, words in told.items():
            yield _problem(step, (*request.location, *at), words)


def _wrong_rooms(request: WrittenRequest, rooms: Rooms, scope: Mapping[str, Any]) -> Iterator[tuple[Location, str]]:
    """Yields the goals of a request that a world's rooms forbid, with the reasons.

    Args:
        request: The request.
        rooms: Rooms of the world.
        scope: Values of variables with which the request names this world.
    """
    for at, node in asked_rooms(request):
        room = text_with(str(node.value), scope)
        if isinstance(room, str) and room not in rooms.names:
            yield at, no_such_room(room, rooms.names)
    order = plain(request.node)
    if starts_on_origin(order) and isinstance(order.get("requirements"), list):
        for index, member, words in goals_at_start(order["requirements"], rooms.start):
            yield ("requirements", index, member), words


def _problem(step: CheckedStep, at: Location, words: str) -> Problem:
    return Problem(value_place(step.input, at), path_text((*step.location, *at)), words)


def _orders(value: Any, at: Location) -> Iterator[tuple[Location, Mapping[str, Any]]]:
    """Yields location and content of every simulation job request in a value."""
    if isinstance(value, Mapping):
        if isinstance(value.get("simulationApplications"), list) or isinstance(value.get("robotApplications"), list):
            yield at, value
        for key, inner in value.items():
            yield from _orders(inner, (*at, key))
    elif isinstance(value, list):
        for index, inner in enumerate(value):
            yield from _orders(inner, (*at, index))


def _objects(value: Any, at: Location) -> Iterator[tuple[Location, str, str]]:
    """Yields location, bucket and key of every object that is given by name; a key in `s3Keys` may be a prefix."""
    if isinstance(value, Mapping):
        bucket, key, keys = value.get("s3Bucket"), value.get("s3Key"), value.get("s3Keys")
        given = [((*at, "s3Key"), key)]
        given += [((*at, "s3Keys", index), each) for index, each in enumerate(keys if isinstance(keys, list) else [])]
        for place, each in given:
            if isinstance(bucket, str) and isinstance(each, str) and "${{" not in bucket + each:
                yield place, bucket, each
        for member, inner in value.items():
            yield from _objects(inner, (*at, member))
    elif isinstance(value, list):
        for index, inner in enumerate(value):
            yield from _objects(inner, (*at, index))


def _written(value: Any) -> Iterator[tuple[str, str]]:
    """Yields bucket and prefix of every place that a request names for its outputs."""
    if isinstance(value, Mapping):
        location = value.get("outputLocation")
        if isinstance(location, Mapping) and isinstance(bucket := location.get("s3Bucket"), str):
            yield bucket, str(location.get("s3Prefix") or "").partition("${{")[0]
        for inner in value.values():
            yield from _written(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from _written(inner)


def _named(value: Any, at: Location) -> Iterator[tuple[Location, str, str]]:
    """Yields location, kind and name of every application that is given by name, not by ARN or reference."""
    if isinstance(value, Mapping):
        for key, inner in value.items():
            if key in _KINDS and isinstance(inner, list):
                yield from _configs(inner, (*at, key), _KINDS[key])
            else:
                yield from _named(inner, (*at, key))
    elif isinstance(value, list):
        for index, inner in enumerate(value):
            yield from _named(inner, (*at, index))


def _configs(configs: list[Any], at: Location, kind: str) -> Iterator[tuple[Location, str, str]]:
    for index, config in enumerate(configs):
        name = config.get("application") if isinstance(config, Mapping) else None
        if isinstance(name, str) and not name.startswith("arn:") and "${{" not in name:
            yield (*at, index, "application"), kind, name
