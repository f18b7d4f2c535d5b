"""Actions of visitors: cancel and restart, as far as their access keys permit."""

from collections.abc import Callable, Mapping

from starlette.responses import RedirectResponse, Response

from ...schemas.wire.errors import ResourceNotFoundException
from .orders import again, going
from .rendering import PAGES, address
from .visit import Visit

_ACTS = {
    ("jobs", "cancel"): ("CancelSimulationJob", "job"),
    ("jobs", "restart"): ("RestartSimulationJob", "job"),
    ("batches", "cancel"): ("CancelSimulationJobBatch", "batch"),
    ("generations", "cancel"): ("CancelWorldGenerationJob", "job"),
}
"""Operations, and the member that names what they are done to, by the address of the form."""

_OTHERS: Mapping[tuple[str, str], Callable[[Visit], Response]] = {
    ("runs", "cancel"): going.cancel,
    ("runs", "again"): again.failed_of_run,
    ("runs", "take-up"): going.take_up,
    ("batches", "again"): again.failed_of_batch,
}
"""Acts that are more than one call, by the address of the form."""


def carry_out(visit: Visit) -> Response:
    """Does what a form asks for, and shows the resource again.

    Raises:
        ResourceNotFoundException: there is no such act, or no such resource.
        AccessDeniedException: the visitor's key is not good for it.
        ServiceError: it cannot be done to the resource as it is.
    """
    folder, resource_id, act = (visit.request.path_params[name] for name in ("folder", "id", "act"))
    if (other := _OTHERS.get((folder, act))) is not None:
        return other(visit)
    found = _ACTS.get((folder, act))
    if found is None:
        raise ResourceNotFoundException(f"there is nothing called {act!r} to do here")
    operation, member = found
    kind = next(kind for kind, each in PAGES.items() if each == folder)
    visit.call(operation, {member: visit.service.arn(kind, resource_id)})
    return RedirectResponse(address(kind, resource_id), 303)
