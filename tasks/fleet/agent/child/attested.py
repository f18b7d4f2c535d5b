"""Whether a version passed its simulations: the attestation of a deployment, believed if a key of the root signed it.

The root names these keys, and the applications of which nothing is installed without an attestation. It is signed by
root keys, which may lie elsewhere: so a server that was taken over, with all other keys of the repository, can neither
name a key of its own nor leave an attestation out.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from securesystemslib.dsse import Envelope
from securesystemslib.exceptions import Error
from tuf.api.metadata import Key  # pyright: ignore[reportPrivateImportUsage]

from ..deployment import Document
from ..errors import StepFailed

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
    """Attestation rules that a root of the repository sets."""

    keys: Mapping[str, Any]
    """Those that are believed, by id, as TUF writes them; none: attestations are not looked at."""

    applications: frozenset[str]
    """Applications of which no version is installed without an attestation."""

    @classmethod
    def of(cls, root: Mapping[str, Any]) -> Attested:
        """Reads what is signed of a root; older ones say nothing of attestations.

        Raises:
            StepFailed: it has another form, which a newer agent may know.
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
        """Refuses a version that was not attested.

        Args:
            document: what is to be installed.
            sha256: of the bundle that this robot would get.
            envelopes: the attestations of the deployment, by path.

        Raises:
            StepFailed: none of them is about this; the text says why of each.
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
        """Explains why an attestation is not accepted; `None`: it attests exactly this version."""
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
