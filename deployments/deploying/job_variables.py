"""Job variables of runs in Prefect work pools, and job templates of work pools for these flows."""

import asyncio
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from prefect.workers.utilities import get_default_base_job_template_for_infrastructure_type

from ...schemas.wire.errors import ConfigurationError
from ...schemas.wire.request_problems import nearest

_STORE_CREDENTIALS = {
    "AWS_ACCESS_KEY_ID": "credentials.aws_access_key_id",
    "AWS_SECRET_ACCESS_KEY": "credentials.aws_secret_access_key",
    "AWS_SESSION_TOKEN": "credentials.aws_session_token",
}
# Variable of the environment by block type: the path of its value in the block. The last two are prefect-aws's.
BLOCK_VARIABLES: Mapping[str, Mapping[str, str]] = {
    "robomaker-object-store": {
        "ROBOMAKER_OBJECT_STORE": "address",
        "ROBOMAKER_BUCKET": "bucket",
        "ROBOMAKER_REGION": "region",
        **_STORE_CREDENTIALS,
    },
    "robomaker-catalog": {"ROBOMAKER_CATALOG_URL": "url"},
    "robomaker-credentials": {name: path.partition(".")[2] for name, path in _STORE_CREDENTIALS.items()},
    "aws-credentials": {name: path.partition(".")[2] for name, path in _STORE_CREDENTIALS.items()},
    "minio-credentials": {"AWS_ACCESS_KEY_ID": "minio_root_user", "AWS_SECRET_ACCESS_KEY": "minio_root_password"},
}

ReadBlock = Callable[[str, str], Mapping[str, Any] | None]
"""Function that returns a block's content without secrets, by type slug and name; `None`: there is none."""


def environment_of_words(words: Sequence[str]) -> dict[str, str]:
    """Parses environment variables given as `NAME=VALUE`.

    Raises:
        ConfigurationError: A word is none.
    """
    variables = {}
    for word in words:
        name, equals, value = word.partition("=")
        if not equals or not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", name):
            raise ConfigurationError(f"--env is {word!r}; NAME=VALUE would be right")
        variables[name] = value
    return variables


def block_of_word(word: str) -> tuple[str, str]:
    """Parses a Prefect block given as `TYPE/NAME`.

    Raises:
        ConfigurationError: The text does not name a block of a type that holds settings.
    """
    slug, _, name = word.partition("/")
    if slug not in BLOCK_VARIABLES or not name:
        advice = nearest(slug, tuple(BLOCK_VARIABLES)) or f"; TYPE is one of {', '.join(BLOCK_VARIABLES)}"
        raise ConfigurationError(f"--block is {word!r}; TYPE/NAME would be right{advice}")
    return slug, name


def environment_of_blocks(blocks: Sequence[str], read: ReadBlock) -> dict[str, str]:
    """Returns environment variables whose values a Prefect worker takes from blocks.

    Args:
        blocks: Each `TYPE/NAME`, as `prefect block ls` shows them.
        read: Reads a block.

    Raises:
        ConfigurationError: A block does not exist, or its type holds no settings.
    """
    variables = {}
    for word in blocks:
        slug, name = block_of_word(word)
        content = read(slug, name)
        if content is None:
            raise ConfigurationError(
                f"--block is {word!r}; the Prefect server has no such block: `prefect block ls` lists those it has"
            )
        for variable, path in BLOCK_VARIABLES[slug].items():
            if _has(content, path):
                variables[variable] = f"{{{{ prefect.blocks.{slug}.{name}.{path} }}}}"
    return variables


def check_image(kind: str, image: str | None) -> None:
    """Checks the container image for runs of a Prefect work pool.

    Args:
        kind: The type of the pool: `process`, `docker` or `kubernetes`.
        image: The image, if one is given.

    Raises:
        ConfigurationError: The pool needs an image and none is given, or it cannot use the image that is given.
    """
    if image is None and kind != "process":
        raise ConfigurationError(
            f"--image is missing: runs in a pool of type {kind} start from an image that has prefect-robomaker, "
            "and Prefect's own has not"
        )
    if image is not None and kind == "process":
        raise ConfigurationError(f"--image is {image!r}; runs in a pool of type process have no image")


def _has(content: Mapping[str, Any], path: str) -> bool:
    """Whether a block has a value at a path; secrets are hidden but count as present."""
    found: Any = content
    for key in path.split("."):
        found = found.get(key) if isinstance(found, Mapping) else None
    return found is not None


TYPES = ("process", "docker", "kubernetes")
_ENVIRONMENT = {
    # A run whose machine dies says nothing more; Prefect's own default, 180 s, tells of that late. 30 is the least.
    "PREFECT_FLOWS_HEARTBEAT_FREQUENCY": "30",
    "DO_NOT_TRACK": "1",
}


def pool_template(
    kind: str, *, image: str | None = None, environment: Mapping[str, str] | None = None
) -> dict[str, Any]:
    """Makes a job template for `prefect work-pool create --base-job-template`.

    Args:
        kind: The type of the pool, one of `TYPES`.
        image: Container image of its runs, which has this package; for docker and kubernetes.
        environment: More variables for its runs.

    Raises:
        ConfigurationError: An image is missing or of no use, or Prefect does not know the type.
    """
    check_image(kind, image)
    template = asyncio.run(get_default_base_job_template_for_infrastructure_type(kind))
    if template is None:
        raise ConfigurationError(
            f"the Prefect server does not say what a pool of type {kind} is made of; `robomaker doctor` tells whether "
            "it answers"
        )
    properties: dict[str, Any] = template["variables"]["properties"]
    properties["env"]["default"] = {**properties["env"].get("default", {}), **_ENVIRONMENT, **(environment or {})}
    if image:
        properties["image"]["default"] = image
    return template
