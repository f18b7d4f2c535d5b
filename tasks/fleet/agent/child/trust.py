"""Verifies deployments with the fleet's TUF repository, the only source of what is installed.

TUF's client believes its own files: if somebody empties those of timestamp and snapshot, it accepts an older
repository. So the newest version of each role that was ever seen, and the latest time at which the repository was
fresh, are in the agent's journal too, and are checked here.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, Callable
from urllib.parse import quote

from securesystemslib.dsse import Envelope
from securesystemslib.exceptions import Error
from tuf.api.exceptions import (
    DownloadError,
    DownloadHTTPError,
    DownloadLengthMismatchError,
    LengthOrHashMismatchError,
    RepositoryError,
)
from tuf.api.metadata import Key  # pyright: ignore[reportPrivateImportUsage]
from tuf.ngclient import Updater
from tuf.ngclient.fetcher import FetcherInterface

from ..deployment import Deployment, Document, File, Order, Version, application_of, parse_document
from ..errors import StepFailed, TryLater, disk_failure
from ..journal import sync_file
from ..state_machine import Trusted
from .fetching import HttpStatus, Source, fetch, refusal

MOST_ATTESTATIONS = 16
"""Limit on the attestations of one deployment; each costs a signature check."""

_MEMBER = "robomaker-attested"
_EVERY_APPLICATION = "*"
_PAYLOAD_TYPE = "application/vnd.in-toto+json"
_STATEMENT_TYPE = "https://in-toto.io/Statement/v1"
_PREDICATE_TYPE = "https://in-toto.io/attestation/test-result/v0.1"
_WRONG = (LookupError, TypeError, ValueError, AttributeError, RecursionError)


@dataclass(frozen=True)
class Attested:
    """Rules in a TUF root: which applications need attestations."""

    keys: Mapping[str, Any]
    """Public keys whose attestations are accepted, by id, as TUF writes them; empty: attestations are not checked."""

    applications: frozenset[str]
    """Names of the applications of which no version is installed without an attestation."""

    @classmethod
    def of(cls, root: Mapping[str, Any]) -> Attested:
        """Reads the attestation rules from a TUF root.

        Raises:
            StepFailed: The document has another form, which a newer agent may know.
        """
        content = root.get(_MEMBER, {"keys": {}, "applications": []})
        try:
            return cls(dict(content["keys"]), frozenset(content["applications"]))
        except _WRONG as error:
            raise _refused(f"the root's {_MEMBER} is not right: {error}") from None

    def is_needed(self, document: Document) -> bool:
        """Whether a deployment needs an attestation."""
        is_named = not self.applications.isdisjoint((document.application, _EVERY_APPLICATION))
        return is_named or (bool(self.keys) and document.batch is not None)

    def check(self, document: Document, sha256: str, envelopes: Mapping[str, bytes]) -> None:
        """Raises an error if the version to install is not attested.

        Args:
            document: Deployment document to install.
            sha256: SHA-256 of the bundle that this robot would get.
            envelopes: The attestations of the deployment, by path.

        Raises:
            StepFailed: None of them is about this; the text says why of each.
        """
        reasons: list[str] = []
        for path, envelope in envelopes.items():
            reason = self._disagreement(document, sha256, envelope)
            if reason is None:
                return
            reasons.append(f"{path} {reason}")
        name = f"version {document.version} of {document.application}"
        raise _refused(f"{name} was not attested: {'; '.join(reasons) or 'the deployment has no attestation'}")

    def _disagreement(self, document: Document, sha256: str, content: bytes) -> str | None:
        """Explains why an attestation is not accepted; `None` if it attests exactly this version."""
        try:
            envelope = Envelope.from_dict(json.loads(content))
            keys = [Key.from_dict(keyid, dict(key)) for keyid, key in self.keys.items()]
            envelope.verify(keys, 1)
            statement = json.loads(envelope.payload)
        except (*_WRONG, Error) as error:
            return f"is not signed by a key that the root names: {error}"
        try:
            return _contradiction(envelope.payload_type, statement, document, sha256)
        except _WRONG as error:
            return f"is no statement of a test result: {error}"


def _contradiction(kind: str, statement: Mapping[str, Any], document: Document, sha256: str) -> str | None:
    found = (kind, statement["_type"], statement["predicateType"])
    if found != (_PAYLOAD_TYPE, _STATEMENT_TYPE, _PREDICATE_TYPE):
        return f"is no statement of a test result, but {found}"
    predicate = statement["predicate"]
    if predicate["result"] != "PASSED":
        return f"has the result {predicate['result']!r}"
    batches = [configuration["uri"] for configuration in predicate["configuration"]]
    if document.batch is not None and document.batch not in batches:
        return f"is about {', '.join(batches)}, and {document.batch} is required"
    about = [subject["digest"]["sha256"] for subject in statement["subject"] if _is_of(subject, document)]
    if sha256 not in about:
        return f"is not about the archive with SHA-256 {sha256}, but {', '.join(about) or 'about other versions'}"
    return None


def _is_of(subject: Mapping[str, Any], document: Document) -> bool:
    facts = subject["annotations"]
    # An ARN ends with `robot-application/NAME/EPOCH`.
    name = str(facts["application"]).split("/")[-2:-1]
    return name == [document.application] and facts["version"] == document.version


def _refused(reason: str) -> StepFailed:
    return StepFailed("RobotDeploymentAborted", f"AttestationError: {reason}")


MAX_DOCUMENT_BYTES = 1 << 20
_TOP_ROLES = ("root", "timestamp", "snapshot", "targets")


class _Fetcher(FetcherInterface):
    """TUF client's access to the repository; its URLs are paths there."""

    def __init__(self, source: Source) -> None:
        self._source = source

    def _fetch(self, url: str) -> Iterator[bytes]:
        try:
            return self._source(url, 0).chunks
        except HttpStatus as error:
            raise DownloadHTTPError(f"{url}: HTTP status {error.status}", error.status) from error


class Repository:
    """Signed update repository (TUF) of a fleet, as the robot's agent reads it.

    Args:
        source: Reads its files.
        root: The root metadata that this robot was enrolled with.
        metadata: Folder of what was seen of it.
        downloads: Folder for documents and condition files.
        clock: The time, in seconds since 1970.
    """

    def __init__(self, source: Source, root: bytes, metadata: Path, downloads: Path, clock: float) -> None:
        self._source = source
        self._root = root
        self._metadata = metadata
        self._downloads = downloads
        self._now_s = clock

    def resolve(
        self,
        order: Order,
        floors: Mapping[str, int],
        newest_s: float,
        architecture: str,
        seen: Callable[[Trusted], None],
    ) -> Deployment:
        """Downloads and verifies the deployment document and condition file of an order.

        Args:
            order: The order.
            floors: Versions that roles must not be older than.
            newest_s: The latest time at which the repository was fresh.
            architecture: The robot's.
            seen: Called with the verified versions and time of the repository, before any of its content is used.

        Raises:
            StepFailed: The metadata is not trusted, or has nothing for this robot.
            TryLater: The server cannot be reached.
        """
        try:
            updater = self._fresh(order, floors, newest_s, seen)
            return self._deployment(updater, order, architecture)
        except DownloadHTTPError as error:
            raise refusal(error.status_code, "its metadata") from error
        except LengthOrHashMismatchError as error:
            raise StepFailed("EtagMismatch", _said(error)) from error
        except (RepositoryError, DownloadLengthMismatchError) as error:
            raise StepFailed("RobotDeploymentAborted", _said(error)) from error
        except DownloadError as error:
            if isinstance(error.__cause__, TryLater):
                raise error.__cause__ from None
            raise TryLater(_said(error)) from error
        except OSError as error:
            raise disk_failure(error, "storing the repository's metadata") from error

    def _fresh(
        self, order: Order, floors: Mapping[str, int], newest_s: float, seen: Callable[[Trusted], None]
    ) -> Updater:
        """Reads the repository's metadata, also of the order's application, and checks it against the journal.

        Reports the versions that were seen. Raises StepFailed if metadata has expired or is older than seen before.
        """
        role = f"application-{application_of(order.target)}"
        self._metadata.mkdir(parents=True, exist_ok=True)
        updater = Updater(str(self._metadata), "metadata/", fetcher=_Fetcher(self._source), bootstrap=self._root)
        updater.refresh()
        self._checked(_TOP_ROLES, floors, newest_s)
        updater.get_targetinfo(order.target)
        seen(self._checked((*_TOP_ROLES, role), floors, newest_s))
        return updater

    def _deployment(self, updater: Updater, order: Order, architecture: str) -> Deployment:
        document = parse_document(self._text(updater, order.target), order.target, architecture)
        bundle = _found(updater, document.bundle)
        self._check_attested(updater, document, bundle)
        condition = None if document.condition is None else _found(updater, document.condition)
        if condition is not None:
            path = self._downloads / condition.sha256
            fetch(self._source, condition, path)
            sync_file(path)  # it is not fetched again once the journal says that it is to be asked
        version = Version(
            document.application, document.version, bundle.sha256, document.launch, document.job, order.tags
        )
        return Deployment(version, bundle, condition, document.number)

    def _check_attested(self, updater: Updater, document: Document, bundle: File) -> None:
        attested = Attested.of(self._signed("root"))
        if attested.is_needed(document):
            paths = document.attestations[:MOST_ATTESTATIONS]
            attested.check(document, bundle.sha256, {path: self._text(updater, path) for path in paths})

    def _text(self, updater: Updater, path: str) -> bytes:
        """Downloads a small target file into memory, and leaves it in the downloads.

        Raises StepFailed if it is too long, or nothing vouches for it.
        """
        target = _found(updater, path)
        if target.length > MAX_DOCUMENT_BYTES:
            raise StepFailed("RobotDeploymentAborted", f"{path} has {target.length} bytes, which is too long")
        text = self._downloads / f"{target.sha256}.json"
        fetch(self._source, target, text)
        return text.read_bytes()

    def _signed(self, role: str) -> dict[str, Any]:
        """Reads the signed part of a role's newest metadata, which TUF has accepted."""
        content: dict[str, Any] = json.loads((self._metadata / f"{quote(role, '')}.json").read_bytes())["signed"]
        return content

    def _checked(self, roles: tuple[str, ...], floors: Mapping[str, int], newest_s: float) -> Trusted:
        """Compares metadata that TUF accepted with versions and times in the agent's journal; returns its versions.

        Raises StepFailed if a role is older than seen before, or has expired. A role without metadata is left out.
        """
        versions: dict[str, int] = {}
        believed = datetime.fromtimestamp(max(newest_s, self._now_s), timezone.utc)
        for role in roles:
            try:
                signed = self._signed(role)
            except FileNotFoundError:
                continue
            versions[role] = signed["version"]
            if signed["version"] < floors.get(role, 0):
                raise StepFailed(
                    "RobotDeploymentAborted",
                    f"BadVersionNumberError: {role} has version {signed['version']}, {floors[role]} was seen before",
                )
            expires = datetime.strptime(signed["expires"], "%Y-%m-%dT%H:%M:%SZ").replace(tzinfo=timezone.utc)
            if expires <= believed:
                raise StepFailed(
                    "RobotDeploymentAborted",
                    f"ExpiredMetadataError: {role} expired at {signed['expires']}, and it was later than that already",
                )
        return Trusted(versions, self._now_s)


def _found(updater: Updater, path: str) -> File:
    """Returns the location of a target in the repository, with the length and the SHA-256 that were signed.

    Raises StepFailed if no role vouches for the target, or it has no SHA-256.
    """
    target = updater.get_targetinfo(path)
    if target is None:
        raise StepFailed("ResourceNotFound", f"no role of the repository vouches for {path}")
    sha256 = target.hashes.get("sha256")
    if sha256 is None:
        raise StepFailed("RobotDeploymentAborted", f"the repository has no SHA-256 of {path}")
    folder, _, name = path.rpartition("/")
    return File(f"{folder}/{sha256}.{name}", target.length, sha256)


def _said(error: Exception) -> str:
    return f"{type(error).__name__}: {error}"
