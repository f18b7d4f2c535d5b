"""Needs of a specification where it runs: objects of the store, installed packages, container images.

A specification names no files of the machine that it is written on. Archives of applications, template bodies and
data sources lie in the object store; so a worker needs the same store, not a copy of the repository.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from ...schemas.specs.model import CheckedSpec
from ...schemas.specs.text import plain
from ...schemas.wire.errors import BucketNotFoundError
from ...tasks.storage import ObjectStore

_PACKAGE = "python://"


@dataclass(frozen=True)
class Need:
    """One thing that has to be there when a step runs."""

    step: str
    uri: str
    """`s3://BUCKET/KEY`, `python://MODULE`, or a container image."""

    @property
    def sentence(self) -> str:
        """Description of the need, in words."""
        if self.uri.startswith("s3://"):
            return f"{self.uri} in the object store (step {self.step})"
        if self.uri.startswith(_PACKAGE):
            return f"the Python package {self.uri.removeprefix(_PACKAGE)}, installed where jobs run (step {self.step})"
        return f"the container image {self.uri} (step {self.step})"


def needs_of(spec: CheckedSpec) -> list[Need]:
    """Lists the needs that the steps name literally; references are known only in a run."""
    found = [Need(name, uri) for name in spec.order for uri in _uris(plain(spec.steps[name].input))]
    return list({need.uri: need for need in reversed(found)}.values())[::-1]


def missing_objects(needs: list[Need], store: ObjectStore) -> list[Need]:
    """Those whose object a store does not have.

    Raises:
        StorageError: the store does not answer.
    """
    missing = []
    for need in needs:
        if need.uri.startswith("s3://"):
            bucket, _, key = need.uri.removeprefix("s3://").partition("/")
            if not _is_there(store, bucket, key):
                missing.append(need)
    return missing


def _is_there(store: ObjectStore, bucket: str, key: str) -> bool:
    """Whether there is such an object, or one whose key begins so: data sources name prefixes, too."""
    try:
        return next(iter(store.list(bucket, key)), None) is not None
    except BucketNotFoundError:
        return False


def _uris(value: Any) -> Iterator[str]:
    if isinstance(value, Mapping):
        bucket, key, keys = value.get("s3Bucket"), value.get("s3Key"), value.get("s3Keys")
        for each in [key, *(keys if isinstance(keys, list) else [])]:
            if isinstance(bucket, str) and isinstance(each, str) and "${{" not in bucket + each:
                yield f"s3://{bucket}/{each}"
        uri = value.get("uri")
        if isinstance(uri, str) and "${{" not in uri:
            yield uri
        for inner in value.values():
            yield from _uris(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from _uris(inner)
