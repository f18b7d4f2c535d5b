"""Finding the world or simulation job that a person means: by ARN, id, the beginning of an id, or name."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain, islice
from pathlib import Path

from pydantic import ValidationError

from ...schemas.documents.simulation_jobs import JobInBrief, SimulationJobDocument
from ...schemas.documents.worlds import WorldDocument
from ...schemas.reports.names import (
    NAME_LABEL,
    ambiguous,
    begins_id,
    composed,
    job_name,
    meant,
    near_names,
    newest_first,
    runs_meant,
    world_name,
)
from ...schemas.reports.run_record import RunRecord
from ...schemas.wire.arns import Kind, ResourceArn
from ...schemas.wire.errors import ConfigurationError, ResourceNotFoundException
from ..catalog import Resource
from .service import Service

WORLD: Kind = "world"
JOB: Kind = "simulation-job"
_GENERATION_JOB: Kind = "world-generation-job"
_KINDS_IN_IDS: Mapping[str, tuple[str, ...]] = {
    WORLD: ("generation", "import", "variation"),
    JOB: ("sim",),
    "simulation-job-batch": ("batch",),
    "world-generation-job": ("generation",),
    "world-export-job": ("export",),
    "deployment-job": ("deployment",),
}
_WORDS: Mapping[str, str] = {WORLD: "worlds", JOB: "simulation jobs"}
_MOST = 12
"""Largest number of candidates that are looked for: a message names five of them."""
_LOOKED_AT = 200
"""Number of newest resources whose names are compared with a text that no label fits."""
_GIVEN_NAMES = ("import-", "variation-")
"""Beginnings of the ids of worlds to which people give names."""
_LATEST = "latest"


def name_of_world(world: Resource, service: Service) -> str:
    """Returns the name of a world: `flat 3`; its id where it has none."""
    return _names({world.arn: world}, service)[world.arn]


def names_of_worlds(arns: Iterable[str], service: Service) -> dict[str, str]:
    """Returns the names of those worlds that the catalog has, by ARN; several may have one name."""
    return _names(service.catalog.get_many(arns), service)


def _names(worlds: Mapping[str, Resource], service: Service) -> dict[str, str]:
    documents = {arn: WorldDocument.of(world) for arn, world in worlds.items()}
    # Those of an early release are called as their template is called now; or it had no name.
    asked = {each.template for each in documents.values() if each.template_name is None and each.template is not None}
    templates = service.catalog.get_many(asked, ()) if asked else {}
    names: dict[str, str] = {}
    for arn, document in documents.items():
        template = templates.get(document.template or "")
        now = template.name if template is not None else None
        names[arn] = document.name or world_name(document.template_name or now, worlds[arn].id)
    return names


def name_of_job(document: SimulationJobDocument | JobInBrief) -> str:
    """Returns the name of a simulation job: `scout in flat 3`; others may have it, too."""
    applications = [*document.robot_application_names, *document.simulation_application_names]
    return job_name(applications[0] if applications else None, document.world_name)


def find_world(wanted: str, service: Service, besides: str = "") -> Resource:
    """Returns the world that a person means by a text.

    Of worlds of one name that are the same to the letter, the newest is taken.

    Args:
        wanted: ARN, id or its beginning (`generation-8285/world-3`), or name (`flat 3`).
        service: The service, with its catalog.
        besides: What else would have been right, for the message: `, nor the folder of a bundle`.

    Raises:
        ConfigurationError: No world is meant, or any of several.
        InvalidParameterException: The ARN of something else.
        ResourceNotFoundException: The catalog has no world of the ARN.
    """
    return _one(wanted, WORLD, service, worlds_meant(wanted, service), besides)


def find_only_world(wanted: str, service: Service) -> Resource:
    """Returns the only world that a text means, as what changes or deletes a world needs it.

    Worlds of one name count as several, even those that are the same to the letter.

    Args:
        wanted: ARN, id or its beginning, or name.
        service: The service, with its catalog.

    Raises:
        ConfigurationError: No world is meant, or any of several.
        InvalidParameterException: The ARN of something else.
        ResourceNotFoundException: The catalog has no world of the ARN.
    """
    return _one(wanted, WORLD, service, worlds_meant(wanted, service, with_equal=True))


def find_job(wanted: str, service: Service, besides: str = "") -> Resource:
    """Returns the simulation job that a person means by a text.

    Args:
        wanted: ARN, id or its beginning (`sim-8285`), name (`scout in flat 3`), or run and name (`latest/scout in …`).
        service: The service, with its catalog and the records of runs.
        besides: What else would have been right, for the message.

    Raises:
        ConfigurationError: No job is meant, or any of several.
        InvalidParameterException: The ARN of something else.
        ResourceNotFoundException: The catalog has no job of the ARN.
    """
    return _one(wanted, JOB, service, jobs_meant(wanted, service), besides)


def find_by_id(wanted: str, kinds: Sequence[Kind], service: Service, besides: str = "") -> Resource:
    """Returns the job or batch that a person means by its ARN, its id, or the beginning of the id.

    Args:
        wanted: ARN, id or its beginning.
        kinds: Kinds of which it may be.
        service: The service, with its catalog.
        besides: What else would have been right, for the message.

    Raises:
        ConfigurationError: Nothing is meant, or any of several.
        InvalidParameterException: The ARN of something else.
        ResourceNotFoundException: The catalog has nothing of the ARN.
    """
    if wanted.startswith("arn:"):
        arn = str(ResourceArn.parse(wanted, *kinds))
        return service.catalog.get(arn)
    found = [each for kind in kinds for each in _by_arn_or_id(wanted, kind, service)]
    words = " or ".join(kind.replace("-", " ") for kind in kinds)
    if not found:
        besides = besides or _job_of_world(wanted, kinds, service)
        known = [
            each.id for kind in kinds for each in service.catalog.list(kind, limit=_LOOKED_AT, members=()).resources
        ]
        raise ConfigurationError(f"{wanted!r} is neither ARN nor id of a {words}{besides}{near_names(wanted, known)}")
    if len(found) > 1:
        raise ConfigurationError(ambiguous(wanted, f"resources ({words})", [each.id for each in found]))
    return found[0]


def _job_of_world(wanted: str, kinds: Sequence[Kind], service: Service) -> str:
    """Returns the generation job of a world that a text means, where one is asked for, as words; empty: none."""
    jobs = (
        {each.id.partition("/")[0] for each in worlds_meant(wanted, service)}
        if _GENERATION_JOB in kinds
        else set[str]()
    )
    made = sorted(job for job in jobs if not job.startswith(_GIVEN_NAMES))
    return f"; it is a world of {' or '.join(made[:3])}" if made else ""


def worlds_meant(wanted: str, service: Service, *, with_equal: bool = False) -> list[Resource]:
    """Lists the worlds that a text may mean, newest first; of equal worlds of one name only the newest.

    An ARN or a whole id goes before names, and names before beginnings of ids: `flat` may be both. With `with_equal`,
    equal worlds are listed too.
    """
    found = _by_arn_or_id(wanted, WORLD, service)
    if wanted.startswith("arn:") or any(each.id == wanted for each in found):
        return found
    return worlds_named(wanted, service, with_equal=with_equal) or found


def worlds_named(name: str, service: Service, *, with_equal: bool = False) -> list[Resource]:
    """Lists the worlds of a name, newest first; of equal worlds only the newest, unless `with_equal`."""
    contents: dict[str, Resource] = {}
    # A template's name may have its accents apart, and so the names of its worlds; given names have them composed.
    labelled = (_with_label(each, WORLD, service) for each in dict.fromkeys((name, composed(name))))
    for world in chain(*labelled, _early_worlds(name, service)):
        bundle = WorldDocument.of(world).bundle
        contents.setdefault(bundle.last_part if bundle and not with_equal else world.id, world)
        if len(contents) == _MOST:
            break
    return list(contents.values())


def jobs_meant(wanted: str, service: Service) -> list[Resource]:
    """Lists the simulation jobs that a text may mean, newest first: by ARN, id, place in a run, or name.

    The list is empty if there is none; of very many with one name only the newest are listed.
    """
    if found := _by_arn_or_id(wanted, JOB, service):
        return found
    if found := _in_run(wanted, service):
        return found
    # By the name that the catalog has: one with parameters is unique within its run only, which has to be said.
    return list(islice(_with_label(wanted, JOB, service), _MOST))


def _one(wanted: str, kind: Kind, service: Service, found: list[Resource], besides: str = "") -> Resource:
    if len(found) == 1:
        return found[0]
    if found:
        in_run = f", or with its run: {_LATEST}/{wanted}" if kind == JOB and NAME_LABEL in found[0].labels else ""
        raise ConfigurationError(ambiguous(wanted, _WORDS[kind], [_told(each, service) for each in found]) + in_run)
    if wanted.startswith("arn:"):
        raise ResourceNotFoundException(f"there is no resource {wanted}")
    known = _known_names(kind, service)
    raise ConfigurationError(
        f"{wanted!r} is neither ARN, id nor name of any of the {_WORDS[kind]}{besides}{near_names(wanted, known)}"
    )


def _known_names(kind: Kind, service: Service) -> list[str]:
    """Returns names and ids that a misspelt one may be meant for: those of the newest, and given ones of any age.

    A generation job makes hundreds of worlds, behind which the one that somebody imported and named is not found.
    """
    found = list(service.catalog.list(kind, limit=_LOOKED_AT).resources)
    given = _GIVEN_NAMES if kind == WORLD else ()
    found += [each for beginning in given for each in service.catalog.with_ids(kind, beginning, limit=_LOOKED_AT)]
    names = _names({each.arn: each for each in found}, service) if kind == WORLD else {}
    known = [name for each in found for name in (names.get(each.arn) or name_of(each, service), each.id)]
    return [*known, *(_names_in_latest_run(service) if kind == JOB else [])]


def _told(resource: Resource, service: Service) -> str:
    """Describes a world or job that a name may mean: its id, name and time, and of a job also its run."""
    run = SimulationJobDocument.of(resource).spec_run if resource.kind == JOB else None
    of_run = f" of {run}" if run else ""
    return f"{resource.id} ({name_of(resource, service)}{of_run}, made {resource.created_at:%Y-%m-%d %H:%M})"


def name_of(resource: Resource, service: Service) -> str:
    """Returns the name of a world or simulation job, its id where it has none; of anything else its own name."""
    if resource.kind == WORLD:
        return name_of_world(resource, service)
    return (name_of_job(SimulationJobDocument.of(resource)) or resource.id) if resource.kind == JOB else resource.name


def _by_arn_or_id(wanted: str, kind: Kind, service: Service) -> list[Resource]:
    if wanted.startswith("arn:"):
        return list(service.catalog.get_many([str(ResourceArn.parse(wanted, kind))]).values())
    if exact := service.catalog.get_many([service.arn(kind, wanted)]):
        return list(exact.values())
    beginning, _, rest = wanted.partition("/")
    beginnings = [beginning] if "-" in beginning else [f"{each}-{beginning}" for each in _KINDS_IN_IDS[kind]]
    if not any(begins_id(wanted, f"{each}{'/' if rest else ''}{rest}") for each in beginnings):
        return []
    ending = f"/{rest}" if rest else ""
    found = [each for part in beginnings for each in service.catalog.with_ids(kind, part, ending, limit=_MOST)]
    return [each for each in found if begins_id(wanted, each.id)]


def _with_label(wanted: str, kind: Kind, service: Service) -> Iterator[Resource]:
    """Yields all worlds or jobs that have the name, newest first: many nights may have made the same world."""
    after = None
    while wanted:
        page = service.catalog.list(kind, filters={NAME_LABEL: [wanted]}, limit=_MOST, after=after)
        yield from page.resources
        if (after := page.next_token) is None:
            return


def _early_worlds(wanted: str, service: Service) -> list[Resource]:
    """Returns the worlds of early releases that have this name: their template's present name, and a number.

    Such worlds have no label with their name. The list is empty if the text does not end in a number.
    """
    template, _, number = wanted.rpartition(" ")
    if not template or not number.isdecimal():
        return []
    templates = service.catalog.list("world-template", filters={"name": [template]}, limit=_MOST, members=()).resources
    if not templates:
        return []
    labels = {"templateId": [each.id for each in templates]}
    worlds = service.catalog.list(WORLD, filters=labels, limit=_LOOKED_AT).resources
    return [world for world in worlds if NAME_LABEL not in world.labels and name_of_world(world, service) == wanted]


def _in_run(wanted: str, service: Service) -> list[Resource]:
    """Returns the jobs that a text means: a run as in `runs_meant`, or `latest`, a slash, and a job's name or id.

    Raises:
        ConfigurationError: The beginning is that of several runs.
    """
    run, _, name = wanted.partition("/")
    record = _record_of(run, service) if run and name else None
    if record is None:
        return []
    arns = {job.label: job.arn for job in record.jobs if job.arn}
    chosen = meant(name, {job.label: (job.name, job.test or "") for job in record.jobs if job.arn})
    return list(service.catalog.get_many(arns[label] for label in chosen).values())


def _names_in_latest_run(service: Service) -> list[str]:
    record = _record_of(_LATEST, service)
    return [f"{_LATEST}/{job.name}" for job in record.jobs if job.name] if record is not None else []


def _record_of(run: str, service: Service) -> RunRecord | None:
    """Returns the record of the run with this id or beginning of an id; `latest` means the latest run that is no probe.

    Returns `None` if there is none or it cannot be read. Raises `ConfigurationError` if the beginning fits several
    runs.
    """
    paths = newest_first((service.settings.home / "runs").glob("*/run.json"))
    if run == _LATEST:
        records = filter(None, map(_read, paths))
        return next((record for record in records if not record.probe), None)
    named = {path.parent.name: path for path in paths}
    found = runs_meant(run, list(named), lambda name: getattr(_read(named[name]), "probe", False))
    if len(found) > 1:
        raise ConfigurationError(ambiguous(run, "runs", found))
    return _read(named[found[0]]) if found else None


def _read(path: Path) -> RunRecord | None:
    try:
        return RunRecord.stored_in(path.parent, path.read_bytes())
    except (ValidationError, OSError):
        return None
