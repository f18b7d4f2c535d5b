"""Pages of fleets, their robots, and their deployments with live progress of the waves."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from starlette.responses import Response

from ....schemas.fleet.documents import DeploymentJobDocument, FleetDocument, RobotDocument
from ....schemas.lifecycles import is_terminal
from ....tasks.catalog import Resource
from ....tasks.fleet.fleet_records import DEPLOYMENT, FLEET, ROBOT, robots_of
from ....tasks.fleet.reporting.deployment_view import view_rollout
from ....tasks.fleet.views.deployment_report import report_of
from ....tasks.fleet.views.fleet_standings import deployed_by, fleet_standing
from ...console.job_states import Look, look_of_status
from ...console.rendering import render
from ...console.streams import Parts
from ...console.visit import Visit

_PAGE_LENGTH = 50
_MOST_DEPLOYMENTS = 20
_EVERY_S = 3.0
_ROBOT_LOOKS = {
    "InSync": "passed",
    "Failed": "failed",
    "NoResponse": "broken",
    "Deploying": "running",
    "PendingNewDeployment": "waiting",
}


@dataclass(frozen=True)
class DeploymentLine:
    """A deployment in a list of the web console."""

    id: str
    look: Look
    deploys: str
    created_at: datetime


@dataclass(frozen=True)
class RobotLine:
    """A robot in a list of the web console."""

    resource: Resource
    look: Look
    fleet: Resource | None
    installed: str
    last_seen: datetime | None


def show_all(visit: Visit) -> Response:
    """Web page with the list of robot fleets."""
    page = visit.listed(FLEET, {}, _PAGE_LENGTH, ("lastDeploymentJob",))
    fleets = visit.seen(page.resources)
    last = {each.arn: FleetDocument.of(each).last_deployment_job or "" for each in fleets}
    found = visit.service.catalog.get_many(filter(None, last.values()))
    jobs = {each.arn: each for each in visit.seen(found.values())}
    lines = [(each, _line(jobs[last[each.arn]]) if last[each.arn] in jobs else None) for each in fleets]
    return visit.page("fleets.html.j2", lines=lines, next_token=page.next_token)


def show(visit: Visit) -> Response:
    """Web page of one fleet, with its robots and newest deployments that the visitor may see.

    Raises ResourceNotFoundException if the visitor may see no such fleet.
    """
    fleet = visit.find(FLEET, visit.request.path_params["id"])
    standing = fleet_standing(fleet, visit.service)
    jobs = visit.service.catalog.list(DEPLOYMENT, filters={"parent": [fleet.arn]}, limit=_MOST_DEPLOYMENTS)
    seen = {each.name: each for each in visit.seen(robots_of(fleet.arn, visit.service))}
    return visit.page(
        "fleet.html.j2",
        fleet=fleet,
        robots=[(each, seen[each.robot], robot_look(each.status)) for each in standing.robots if each.robot in seen],
        deployments=[_line(job) for job in visit.seen(jobs.resources)],
    )


def show_robots(visit: Visit) -> Response:
    """Web page with the list of robots."""
    page = visit.listed(ROBOT, {}, _PAGE_LENGTH, ())
    found = list(visit.service.catalog.get_many(each.arn for each in visit.seen(page.resources)).values())
    lines = sorted(_robot_lines(found, visit), key=lambda line: line.resource.created_at, reverse=True)
    return visit.page("robots.html.j2", lines=lines, next_token=page.next_token)


def show_robot(visit: Visit) -> Response:
    """Web page of one robot, with its deployments that the visitor may see.

    Raises ResourceNotFoundException if the visitor may see no such robot.
    """
    robot = visit.find(ROBOT, visit.request.path_params["id"])
    document = RobotDocument.of(robot)
    last = visit.service.catalog.get_many(filter(None, [document.last_deployment_job, document.installed_by]))
    deployments = [_line(job) for job in visit.seen(last.values())]
    [line] = _robot_lines([robot], visit)
    return visit.page("robot.html.j2", line=line, document=document, deployments=deployments)


def show_deployment(visit: Visit) -> Response:
    """Web page of one deployment to robots.

    Raises ResourceNotFoundException if the visitor may see no such deployment.
    """
    job = visit.find(DEPLOYMENT, visit.request.path_params["id"])
    return visit.page("deployment.html.j2", **_shown(job, visit))


def follow_deployment(visit: Visit) -> Response:
    """Streams changes of a deployment's web page until the deployment has ended.

    Raises ResourceNotFoundException if the visitor may see no such deployment.
    """
    job_id = visit.request.path_params["id"]
    visit.find(DEPLOYMENT, job_id)
    parts = Parts()

    def look() -> Iterator[tuple[str, Any]]:
        job = visit.find(DEPLOYMENT, job_id)
        yield from parts.news({"rollout": render("deployment_parts.html.j2", **_shown(job, visit))})
        if is_terminal(DEPLOYMENT, job.status):
            yield "end", None

    return visit.follow(look, _EVERY_S)


def robot_look(status: str) -> Look:
    """Returns the display (text, CSS class, icon) of a robot's status."""
    return Look(_ROBOT_LOOKS.get(status, "unjudged"), status)


def _shown(job: Resource, visit: Visit) -> dict[str, Any]:
    fleet = visit.service.catalog.get_many([str(job.parent)], ())
    return {
        "job": job,
        "page": view_rollout(report_of(job, visit.service)),
        "fleet": next(iter(visit.seen(fleet.values())), None),
        "has_ended": is_terminal(DEPLOYMENT, job.status),
        "rolls_back": DeploymentJobDocument.of(job).rolls_back,
    }


def _line(job: Resource) -> DeploymentLine:
    return DeploymentLine(job.id, look_of_status(DEPLOYMENT, job.status), " ".join(deployed_by(job)), job.created_at)


def _robot_lines(robots: Sequence[Resource], visit: Visit) -> list[RobotLine]:
    documents = [RobotDocument.of(robot) for robot in robots]
    arns = {document.fleet for document in documents if document.fleet}
    fleets = {each.arn: each for each in visit.seen(visit.service.catalog.get_many(arns, ()).values())}
    return [
        RobotLine(
            resource=robot,
            look=robot_look(robot.status),
            fleet=fleets.get(document.fleet or ""),
            installed=document.installed or "",
            last_seen=None if document.last_seen_s is None else datetime.fromtimestamp(document.last_seen_s, UTC),
        )
        for robot, document in zip(robots, documents, strict=True)
    ]


MENU = (6, "fleets", "Fleets")
FOLDERS = {FLEET: "fleets", ROBOT: "robots", DEPLOYMENT: "deployments"}
PAGES = {
    "/fleets": show_all,
    "/fleets/{id:path}": show,
    "/robots": show_robots,
    "/robots/{id:path}": show_robot,
    "/deployments/{id}": show_deployment,
    "/deployments/{id}/live": follow_deployment,
}
"""Handlers of the console's fleet pages, by URL path."""
