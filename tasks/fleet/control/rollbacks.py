"""Rollbacks of failed deployments: robots with the new version get the version that they had before.

A deployment job has one version, so robots that had different ones get several jobs, one after the other. Each job is
created once, whichever process does it and wherever one dies: its client token is made from the failed job and the
earlier version.
"""

import hashlib
import json
import logging
from collections.abc import Iterable
from dataclasses import dataclass

from ....schemas.fleet.documents import DeploymentJobDocument, RobotsRolledBack
from ....schemas.fleet.rollouts.rollout import Rollback, Rollout
from ....schemas.lifecycles import is_terminal
from ....schemas.wire.errors import ResourceNotFoundException, ThrottlingException
from ...catalog import ClientToken, Resource
from ...service.service import Service
from ..fleet_records import DEPLOYMENT, fleet_held, last_deployment, rollout_of, settle
from ..kept_rollouts import KeptRollout, OpenRollout
from ..rollout.ledger import Ledger

TAG = "robomaker:rollback-of"
"""Tag of rollback jobs; its value is the ARN of the failed deployment job."""

_TOKENS = "RollBackDeployment"  # their own: no caller's token is ever the same
_KEPT = ("concurrentDeploymentPercentage", "robotDeploymentTimeoutInSeconds", "maintenanceWindows")


@dataclass(frozen=True)
class _Return:
    """Group of robots that go back to the same version in a rollback."""

    earlier: Resource
    """Earlier deployment job that had installed the version to return to."""

    version: str
    """Version to return to: application, version and launch configuration, as text."""

    robots: tuple[str, ...]


def roll_back(job: str, service: Service) -> bool:
    """Continues the rollback of a failed deployment: creates the next job that returns robots to their old version.

    Args:
        job: ARN of a deployment job.
        service: The service, with its catalog and object store.

    Returns:
        Whether more is to be done later.

    Raises:
        ThrottlingException: Others have kept changing the fleet; ask again.
        ServiceUnavailableException: The catalog does not answer; ask again.
    """
    rollout = rollout_of(job, service)
    if rollout is None or not rollout.rollback_is_due:
        return False
    failed = service.catalog.get(job, kind=DEPLOYMENT)
    try:
        with fleet_held(str(failed.parent), service) as fleet:
            return _next(KeptRollout(failed, service), fleet, service)
    except ResourceNotFoundException:  # the fleet was deleted: there are no robots of it
        KeptRollout(failed, service).note_rollback(Rollback(is_complete=True, reason="the fleet was deleted"))
        return False


def _next(kept: KeptRollout, fleet: Resource, service: Service) -> bool:
    """Creates the next rollback jobs of a failed deployment, and records them; the caller holds the fleet's lock.

    Returns True if a rollback job has to end before the next can be made. It is over if another deployment came in
    between.
    """
    rollout = kept.rollout
    if not rollout.rollback_is_due:
        return False
    returns, left = _returns(rollout, service)
    made: list[str] = []
    reason = None if returns else "no robot that has the new version had another before"
    for each in returns:
        found = service.find_by_client_token(_token(kept.job, each))
        if found is None:
            last = last_deployment(fleet.arn, service)
            if last is not None and last.arn not in (kept.job.arn, *made):
                reason = f"the fleet has had another deployment since: {last.arn}"
                break
            if made and last is not None and not is_terminal(DEPLOYMENT, last.status):
                kept.note_rollback(Rollback(jobs=tuple(made), left=left))
                return True
            found = _made(kept.job, each, fleet, service)
            settle(fleet, service)
        made.append(found.arn)
    kept.note_rollback(Rollback(jobs=tuple(made), left=left, is_complete=True, reason=reason))
    return False


def _returns(rollout: Rollout, service: Service) -> tuple[list[_Return], tuple[str, ...]]:
    """Groups the robots that have the new version by the version they had before; also returns those that had none."""
    planned = {robot.arn: robot.earlier_job for robot in rollout.plan.robots}
    switched = [
        arn for arn in rollout.plan.order if rollout.robots[arn].outcome == "succeeded" and not rollout.robots[arn].gone
    ]
    jobs = service.catalog.get_many(sorted({planned[arn] or "" for arn in switched} - {""}))
    by_version: dict[str, list[str]] = {}
    newest: dict[str, Resource] = {}
    left: list[str] = []
    for arn in switched:
        earlier = jobs.get(planned[arn] or "")
        if earlier is None:
            left.append(arn)
            continue
        version = json.dumps(DeploymentJobDocument.of(earlier).deployment_application_configs, sort_keys=True)
        by_version.setdefault(version, []).append(arn)
        newest.setdefault(version, earlier)
    returns = [_Return(newest[version], version, tuple(robots)) for version, robots in by_version.items()]
    return returns, tuple(left)


def _token(failed: Resource, each: _Return) -> ClientToken:
    made_of = hashlib.sha256(f"{failed.arn} {each.version}".encode()).hexdigest()
    return ClientToken(_TOKENS, made_of[:64], made_of)


def _made(failed: Resource, each: _Return, fleet: Resource, service: Service) -> Resource:
    config = DeploymentJobDocument.of(failed).deployment_config
    document = DeploymentJobDocument(
        deployment_application_configs=DeploymentJobDocument.of(each.earlier).deployment_application_configs,
        # As many robots as can go back: a threshold would leave the others with the version that is bad.
        deployment_config={
            **{name: config[name] for name in _KEPT if name in config},
            "failureThresholdPercentage": 100,
        },
        rolls_back=RobotsRolledBack(job=failed.arn, robots=list(each.robots), earlier=each.earlier.arn),
    )
    labels = {"fleetName": [fleet.name]}
    tags = {TAG: failed.arn}
    return service.store_job(
        DEPLOYMENT, "deployment", document, tags=tags, token=_token(failed, each), parent=fleet.arn, labels=labels
    )


_KEEP_ALIVE_S = 30.0  # well below the gap that counts as an outage
_LOGGER = logging.getLogger("robomaker.robots")


class EndedRollouts:
    """Completes work after deployments have ended, such as rollbacks. For one thread.

    Args:
        service: The service, with its catalog and object store.
    """

    def __init__(self, service: Service) -> None:
        self._service = service
        self._wakes: dict[tuple[str, int], float | None] = {}
        self._alive_s: dict[str, float] = {}

    def tend(self, rollouts: Iterable[OpenRollout]) -> None:
        """Does the work that is due for rollouts whose jobs have ended.

        Args:
            rollouts: Open rollouts; those of jobs that have not ended are left to their runs.

        Raises:
            ServiceUnavailableException: The catalog does not answer; ask again.
        """
        ended = [each for each in rollouts if each.rollout.status != "InProgress"]
        known = {(each.job, each.revision) for each in ended}
        self._wakes = {key: wake_s for key, wake_s in self._wakes.items() if key in known}
        for each in ended:
            try:
                self._tend(each)
            except (ResourceNotFoundException, ThrottlingException) as error:
                _LOGGER.info("%s: %s", each.job, error)  # deleted meanwhile, or the fleet is being changed: next time

    def _tend(self, each: OpenRollout) -> None:
        now_s = self._service.clock().timestamp()
        if each.rollout.rollback_is_due:
            roll_back(each.job, self._service)
        wake_s = self._wake_s(each)
        if wake_s is None:
            self._alive_s.pop(each.job, None)
        elif wake_s <= now_s:
            self._kept(each).fold()
            self._alive_s[each.job] = now_s
        elif now_s - self._alive_s.setdefault(each.job, each.rollout.now_s) >= _KEEP_ALIVE_S:
            kept = self._kept(each)
            if not kept.fold():  # which also sees whether nothing was served meanwhile
                kept.keep_alive()
            self._alive_s[each.job] = now_s

    def _wake_s(self, each: OpenRollout) -> float | None:
        key = (each.job, each.revision)
        if key not in self._wakes:
            self._wakes[key] = Ledger(each.rollout).wake_s()
        return self._wakes[key]

    def _kept(self, each: OpenRollout) -> KeptRollout:
        return KeptRollout(self._service.catalog.get(each.job), self._service)
