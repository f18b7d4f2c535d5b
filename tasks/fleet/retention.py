"""Deletes files of old deployments that no robot needs; keeps batches that deployments require."""

from collections.abc import Iterator
from dataclasses import dataclass

from ...schemas.fleet.documents import DeploymentJobDocument, FleetDocument, RobotDocument
from ...schemas.fleet.rollouts.rollout_plan import Artifact, Delivery
from ...schemas.lifecycles import is_terminal
from ...schemas.reports.retention import GcItem, RetentionPolicy
from ...schemas.wire.errors import BucketNotFoundError, RobomakerError, ServiceUnavailableException
from ..catalog import Resource
from ..service.service import Service
from ..storage.object_store import ObjectInfo
from .catalog_rollouts import Rollouts

FOLDER = "robots/"

_DEPLOYMENT, _ROBOT = "deployment-job", "robot"
_WRAPPED = (".swu", ".json")
_PAGE = 500


@dataclass(frozen=True)
class _Needed:
    keys: frozenset[str]
    documents: frozenset[str]


def needed_orders(service: Service) -> dict[str, str]:
    """Returns the simulation batches that the fleets' last deployments require, each with the deployment's ARN.

    Repeating that deployment for robots that lack it needs them again.
    """
    last = (FleetDocument.of(fleet).last_deployment_job for fleet in _all("deployment-fleet", service))
    deployments = service.catalog.get_many([arn for arn in last if arn is not None]).values()
    required = ((DeploymentJobDocument.of(job).required_batch, job.arn) for job in deployments)
    return {batch: job for batch, job in required if batch is not None}


def collect(policy: RetentionPolicy, service: Service, *, act: bool) -> tuple[list[GcItem], list[str]]:
    """Deletes deployment files that no robot needs any more, according to the retention policy.

    Args:
        policy: Retention policy, with the number of newest deployments of each fleet that keep their files.
        service: The service, with its catalog and object store.
        act: Whether files are deleted; otherwise the result only says which would be.

    Returns:
        The deleted files as one item, and notes about files that could not be judged.
    """
    keep = policy.keep_deployments
    if keep is None:
        return [], []
    preparing = next((job for job in _all(_DEPLOYMENT, service) if _is_preparing(job)), None)
    if preparing is not None:
        return [], [f"files for robots are left: {preparing.arn} is {preparing.status}, and may need them"]
    needed = _needed(keep, service)
    wrapped = [info for info in _wrapped(service) if info.key not in needed.keys]
    objects, size_bytes, problem = len(wrapped), sum(info.size_bytes for info in wrapped), None
    try:
        if act:
            # Records of files first: a file without one is made again.
            for info in sorted(wrapped, key=lambda info: info.key.endswith(".swu")):
                service.store.delete(info.bucket, info.key)
        more = _collect_repository(needed, service, act=act)
        objects, size_bytes = objects + len(more), size_bytes + sum(info.size_bytes for info in more)
    except ServiceUnavailableException:
        raise
    except RobomakerError as error:
        problem = str(error)
    if not objects and problem is None:
        return [], []
    about = GcItem(kind="robot-files", id=FOLDER, action="remove", problem=problem)
    return [about.model_copy(update={"objects": objects, "size_bytes": size_bytes})], []


def _collect_repository(needed: _Needed, service: Service, *, act: bool) -> tuple[ObjectInfo, ...]:
    if not (service.settings.home / "robots" / "trust" / "root.json").exists():
        return ()
    from .trust.publishing import publisher_of
    from .trust.upkeep import find_unneeded, remove_unneeded  # they need the extra `fleet`

    publisher = publisher_of(service)
    unneeded = find_unneeded(publisher, needed.documents)
    if act:
        remove_unneeded(publisher, unneeded)
    return unneeded.objects


def _needed(keep: int, service: Service) -> _Needed:
    """Returns the artifacts needed by the newest deployments, by open ones, and by the last one of each robot."""
    jobs = set(Rollouts(service.catalog).open_rollouts())
    jobs |= {job for robot in _all(_ROBOT, service) if (job := RobotDocument.of(robot).last_deployment_job)}
    counts: dict[str, int] = {}
    for job in _all(_DEPLOYMENT, service):  # newest first
        fleet = str(job.parent)
        counts[fleet] = counts.get(fleet, 0) + 1
        if counts[fleet] <= keep or not is_terminal(job.kind, job.status):
            jobs.add(job.arn)
    artifacts = [artifact for job in jobs for artifact in _artifacts(job, service)]
    keys = {artifact.key for artifact in artifacts}
    records = {info.key for info in _wrapped(service) if info.key.endswith(".json") and _named(info, service) in keys}
    return _Needed(frozenset(keys | records), frozenset(each.target for each in artifacts if each.target))


def _artifacts(job: str, service: Service) -> list[Artifact]:
    stored = Rollouts(service.catalog).rollout(job)
    if stored is None:
        return []
    delivery = Delivery.of_json(dict(stored.delivery))
    return [*delivery.artifacts.values(), *delivery.agent_artifacts.values()]


def _wrapped(service: Service) -> list[ObjectInfo]:
    """Lists the signed files of updaters, and their records; objects in subfolders are left out."""
    try:
        found = list(service.store.list(service.settings.bucket, FOLDER))
    except BucketNotFoundError:
        return []
    return [info for info in found if "/" not in info.key.removeprefix(FOLDER) and info.key.endswith(_WRAPPED)]


def _named(record: ObjectInfo, service: Service) -> str:
    """Returns the object-store key of the file that a record names; empty if the record cannot be read."""
    try:
        return Artifact.model_validate_json(service.store.get_bytes(record.bucket, record.key)).key
    except (RobomakerError, ValueError):
        return ""


def _is_preparing(job: Resource) -> bool:
    return job.status in ("Pending", "Preparing")


def _all(kind: str, service: Service) -> Iterator[Resource]:
    after = None
    while True:
        page = service.catalog.list(kind, limit=_PAGE, after=after)
        yield from page.resources
        if (after := page.next_token) is None:
            return
