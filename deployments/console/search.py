"""The search: by ARN, id, name or tag."""

from urllib.parse import quote, urlencode

from starlette.responses import RedirectResponse, Response

from .rendering import HOME, PAGES, address
from .runs import is_known
from .visit import Visit

_MOST_CHARACTERS = 1300
_NAMED = ("world-template", "simulation-application", "robot-application", "deployment-fleet", "robot")


def find(visit: Visit) -> Response:
    """Leads to what was searched for, or shows what has that name."""
    wanted = visit.parameter("q").strip()[:_MOST_CHARACTERS]
    catalog, service = visit.service.catalog, visit.service
    arns = [wanted] if wanted.startswith("arn:") else [service.arn(kind, wanted) for kind in (*PAGES, *_NAMED)]
    for resource in visit.seen(catalog.get_many(arns, ()).values()):
        if page := address(resource.kind, resource.id):
            return RedirectResponse(page, 303)
    if is_known(wanted, visit):
        return RedirectResponse(f"{HOME}/runs/{quote(wanted)}", 303)
    if "=" in wanted:
        return RedirectResponse(f"{HOME}/jobs?{urlencode({'tag': wanted})}", 303)
    named = [found for kind in _NAMED if wanted and (found := catalog.find(kind, wanted)) is not None]
    named = visit.seen(named)
    if len(named) == 1:
        return RedirectResponse(address(named[0].kind, named[0].id), 303)
    return visit.page("search.html.j2", wanted=wanted, named=named, status=200 if named else 404)
