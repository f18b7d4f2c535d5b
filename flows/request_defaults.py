"""Default values for members that the service requires, for callers in Python who leave them out.

API clients and the endpoint have to give these members, as with AWS; so have specifications, except for `iamRole`.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from ..schemas.roles import LOCAL_ROLE
from ..schemas.wire.operation_shape import OperationShape
from ..tasks.service.service import Service

_HOUR_S = 3600
"""Duration limit in seconds of jobs whose caller gives none: ten times that of the longest built-in mission."""

_VALUES: Mapping[str, Any] = MappingProxyType(
    {
        "iamRole": LOCAL_ROLE,
        "maxJobDurationInSeconds": _HOUR_S,
        "robotSoftwareSuite": {"name": "General"},
        "simulationSoftwareSuite": {"name": "SimulationRuntime"},
        "worldCount": {"floorplanCount": 1, "interiorCountPerFloorplan": 1},
    }
)
_TOKEN, _PLACE = "clientRequestToken", "outputLocation"
_TOKEN_BITS = 128
_CREATE = ("Create", "SyncDeploymentJob")
"""Prefixes of the operations with defaults; in update operations, defaults would change values that the caller did not
give.
"""


def default_members(shape: OperationShape) -> dict[str, Any]:
    """Returns the required members of an operation that have a default, with the fixed defaults.

    Args:
        shape: Shape of the operation.

    Returns:
        Default values by member; `None`: a new value is made for each call.
    """
    if not shape.name.startswith(_CREATE):
        return {}
    required = {name for name, field in shape.request.model_fields.items() if field.is_required()}
    made = dict.fromkeys((_TOKEN, _PLACE), None)
    return {name: value for name, value in {**_VALUES, **made}.items() if name in required}


def with_defaults(shape: OperationShape, given: Mapping[str, Any], *, bucket: str, token: str) -> dict[str, Any]:
    """Returns the members of a request with the defaults of those that were left out.

    Args:
        shape: Shape of the operation.
        given: Members by name; those that are `None` count as left out.
        bucket: Name of the bucket for outputs.
        token: Unique client token.
    """
    present = {name: value for name, value in given.items() if value is not None}
    defaults = default_members(shape) | {_TOKEN: token, _PLACE: {"s3Bucket": bucket}}
    return {name: defaults[name] for name in default_members(shape)} | present


def with_defaults_of(shape: OperationShape, given: Mapping[str, Any], service: Service) -> dict[str, Any]:
    """Returns the members of a request with the defaults of a service's settings; see `with_defaults`."""
    token = f"{service.chance.getrandbits(_TOKEN_BITS):032x}"
    return with_defaults(shape, given, bucket=service.settings.bucket, token=token)
