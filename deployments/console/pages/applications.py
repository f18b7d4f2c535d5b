"""Pages of robot and simulation applications, their versions, and the latest jobs that used them."""

from starlette.responses import Response

from ....schemas.documents.applications import ApplicationDocument
from ....schemas.documents.simulation_jobs import JobInBrief
from ....schemas.wire.errors import ResourceNotFoundException
from ....tasks.service.service import is_builtin
from ....tasks.simulations.planning.applications import version_kind
from ..job_states import JOB, job_line
from ..visit import Visit

KINDS = ("robot-application", "simulation-application")
_PAGE_LENGTH = 50
_MOST_VERSIONS = 40
_MOST_JOBS = 10


def show_all(visit: Visit) -> Response:
    """Web page with the list of robot and simulation applications."""
    after = visit.parameter("after") or None
    page = visit.service.catalog.list(KINDS, limit=_PAGE_LENGTH, after=after, scope="console")
    lines = [(each, ApplicationDocument.of(each), is_builtin(each)) for each in visit.seen(page.resources)]
    return visit.page("applications.html.j2", lines=lines, next_token=page.next_token)


def show(visit: Visit) -> Response:
    """Web page of one robot or simulation application, with its newest versions and jobs.

    Raises ResourceNotFoundException if there is no such kind, or no such application that the visitor may see.
    """
    kind = visit.request.path_params["kind"]
    if kind not in KINDS:
        raise ResourceNotFoundException(f"there is no kind of applications called {kind!r}")
    application = visit.find(kind, visit.request.path_params["id"])
    catalog = visit.service.catalog
    versions = catalog.children(application.arn, version_kind(kind))[-_MOST_VERSIONS:]
    label = "robotApplicationName" if kind == KINDS[0] else "simulationApplicationName"
    jobs = catalog.list(JOB, filters={label: [application.name]}, limit=_MOST_JOBS, members=JobInBrief.members())
    return visit.page(
        "application.html.j2",
        application=application,
        document=ApplicationDocument.of(application),
        is_builtin=is_builtin(application),
        versions=[(each, ApplicationDocument.of(each)) for each in reversed(versions)],
        jobs=[job_line(job) for job in visit.seen(jobs.resources)],
    )


MENU = (7, "applications", "Applications")
FOLDERS = {kind: f"applications/{kind}" for kind in KINDS}
PAGES = {
    "/applications": show_all,
    "/applications/{kind}/{id:path}": show,
}
