"""Environment that a run needs: recorded when it begins, and compared before another process resumes it.

Its steps are not resolved yet when it begins, so the packages that they will import are read from its specification.
"""

from collections.abc import Iterator, Mapping
from typing import Any

from ...schemas.job_owners import NeededEnvironment
from ...schemas.specs.specification import CheckedSpec
from ...schemas.specs.yaml_nodes import plain
from ...schemas.wire.errors import RobomakerError
from ...schemas.wire.json_values import is_list, is_mapping
from ..jobs.job_owners import SETTINGS, environment_with
from ..service.service import Service
from ..simulations.planning.applications import python_package
from ..simulations.planning.job_contents import CurrentApplications, imported_packages, package_content

_BUILT_IN = "built in"


def environment_of_run(spec: CheckedSpec, service: Service) -> NeededEnvironment:
    """Returns the parts of this process's environment that a run of a specification needs to be resumed.

    Args:
        spec: The run's specification.
        service: The service, with the applications and the current settings.
    """
    inputs = {name: plain(step.input) for name, step in spec.steps.items()}
    operations = {step.operation for step in spec.steps.values()}
    names = [each for operation in sorted(operations) for each in SETTINGS.get(operation, ())]
    found = list(_mappings(inputs))
    if any(each.get("iamRole") for each in found):
        names.append("roles_file")
    simulates = bool(operations & {"CreateSimulationJob", "StartSimulationJobBatch"})
    return environment_with(names, _packages(found, service), service.settings, simulates=simulates)


def _packages(found: list[Mapping[str, Any]], service: Service) -> dict[str, str] | None:
    """Returns the digests of the packages that the run imports, by name; `None` if it uses only built-in code."""
    packages: dict[str, str] = {}
    imports_own = False
    for each in found:
        uri = each.get("uri")
        module = python_package(uri) if isinstance(uri, str) else None
        if module and (content := package_content(module)) != _BUILT_IN:
            packages[module.partition(".")[0]] = content
        imports_own = imports_own or bool(each.get("sources"))
    # Applications that are there already; those that the run makes are not.
    roles = ("robotApplications", "simulationApplications")
    requests = [each for each in found if any(is_list(each.get(role)) for role in roles)]
    try:
        known = imported_packages(requests, CurrentApplications(service))
    except (RobomakerError, LookupError, TypeError, AttributeError):  # what is written there is checked by its step
        known = {}
    if known is None and not packages and not imports_own:
        return None
    return {**(known or {}), **packages}


def _mappings(value: Any) -> Iterator[Mapping[str, Any]]:
    """Yields all mappings in a nested value."""
    if is_mapping(value):
        yield value
        for inner in value.values():
            yield from _mappings(inner)
    elif is_list(value):
        for inner in value:
            yield from _mappings(inner)
