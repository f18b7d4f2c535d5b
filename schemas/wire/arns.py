"""ARNs (names of resources): `arn:<partition>:robomaker:<region>:<account>:<kind>/<id>`.

| kind | id |
| --- | --- |
| `robot-application`, `simulation-application`, `robot`, `deployment-fleet` | `<name>/<created, ms since 1970>` |
| `simulation-job`, `simulation-job-batch`, `deployment-job` | `sim-…`, `batch-…`, … |
| `world-template`, `world-generation-job`, `world-export-job` | `template-…`, `generation-…`, `export-…` |
| `world` | `<id of the generation job>/world-<n>`; `import-…`, `variation-…` for those that no job made |
"""

import random
import re
import string
from dataclasses import dataclass
from datetime import datetime
from typing import Literal, get_args

from .errors import InvalidParameterException
from .request_problems import nearest

Kind = Literal[
    "robot-application",
    "simulation-application",
    "simulation-job",
    "simulation-job-batch",
    "deployment-job",
    "robot",
    "deployment-fleet",
    "world-generation-job",
    "world-export-job",
    "world-template",
    "world",
]

_FORM = re.compile(
    r"arn:(?P<partition>aws[a-z-]*):robomaker:(?P<region>[a-z0-9-]+):(?P<account>[0-9]{12}):(?P<kind>[a-z-]+)/(?P<id>.+)"
)
_WANTED = "arn:aws:robomaker:<region>:<account>:<kind>/<id>"
_NAMED = frozenset({"robot-application", "simulation-application", "robot", "deployment-fleet"})
_KINDS: dict[str, Kind] = {kind: kind for kind in get_args(Kind)}


@dataclass(frozen=True)
class ResourceArn:
    """An Amazon Resource Name (ARN), split into its parts; `str()` joins them."""

    region: str
    account: str
    kind: Kind
    id: str
    """Part after the kind; it may contain slashes."""

    partition: str = "aws"

    def __str__(self) -> str:
        return f"arn:{self.partition}:robomaker:{self.region}:{self.account}:{self.kind}/{self.id}"

    @property
    def name(self) -> str:
        """Name of the resource: for applications, robots and fleets the one in the ARN, for others the id."""
        return self.id.partition("/")[0] if self.kind in _NAMED else self.id

    @classmethod
    def parse(cls, arn: str, *kinds: Kind) -> "ResourceArn":
        """Parses an ARN into its parts.

        Args:
            arn: Text to parse.
            kinds: Allowed kinds of resources; none given: all.

        Raises:
            InvalidParameterException: The text is not an ARN of this service, or is that of another kind of resource.
        """
        if (found := _FORM.fullmatch(arn)) is None:
            raise InvalidParameterException(f"{arn!r} is no ARN of a resource; it has to look like {_WANTED}")
        if (kind := _KINDS.get(found["kind"])) is None:
            hint = nearest(found["kind"], _KINDS) or f"; known are {', '.join(_KINDS)}"
            raise InvalidParameterException(f"{arn!r} names a {found['kind']!r}, which is not known{hint}")
        if kinds and kind not in kinds:
            raise InvalidParameterException(f"{arn!r} names a {kind}; it has to name a {' or '.join(kinds)}")
        return cls(found["region"], found["account"], kind, found["id"], found["partition"])


def resource_arn(region: str, account: str, kind: str, resource_id: str) -> str:
    """Makes the ARN of a resource that is identified by an id.

    Raises:
        ValueError: The service has no such kind of resource.
    """
    if kind not in _KINDS:
        raise ValueError(f"there is no kind of resource {kind!r}{nearest(kind, _KINDS)}")
    return str(ResourceArn(region, account, _KINDS[kind], resource_id))


def application_arn(region: str, account: str, kind: str, name: str, created_at: datetime) -> str:
    """Makes the ARN of an application, robot or fleet from its name and its creation time.

    Raises:
        ValueError: The service has no such kind of resource.
    """
    return resource_arn(region, account, kind, f"{name}/{round(created_at.timestamp() * 1000)}")


IdPrefix = Literal["sim", "batch", "template", "generation", "export", "deployment", "import", "variation"]

_ALPHABET = string.digits + string.ascii_lowercase
_LENGTH = 12


def new_id(prefix: IdPrefix, source: random.Random) -> str:
    """Makes a random resource id: the prefix, a hyphen, twelve digits and small letters.

    Args:
        prefix: Prefix of ids of this kind of resource.
        source: Source of randomness; `random.SystemRandom()` where ids have to differ
            between processes.
    """
    return f"{prefix}-{''.join(source.choices(_ALPHABET, k=_LENGTH))}"


def world_id(generation_id: str, number: int) -> str:
    """Makes the id of a world from its generation job's id and its number, counted from 1: `generation-…/world-3`.

    Raises:
        ValueError: The number is below 1.
    """
    if number < 1:
        raise ValueError(f"world number is {number}; worlds are counted from 1")
    return f"{generation_id}/world-{number}"
