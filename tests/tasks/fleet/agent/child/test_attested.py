# pyright: reportPrivateImportUsage=false
"""Attestations on the robot: what a server without the attestation's key and without root keys does not get installed.

Envelopes are made by hand here, as the DSSE says: nothing is shared with the code that is tested.
"""

import base64
import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import pytest
from helpers.tuf_repository import APPLICATION, bundle
from securesystemslib.signer import CryptoSigner

from .conftest import Robot, refused

BATCH = "arn:aws:robomaker:us-west-2:123456789012:simulation-job-batch/batch-1"
PACKED = bundle({"drive": "tested"})
OTHER = bundle({"drive": "evil"})
KIND = "application/vnd.in-toto+json"


def sha256_of(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def statement(packed: bytes = PACKED, **changes: str) -> dict[str, Any]:
    """What is said of an archive of version 1: that it passed."""
    said = {"application": APPLICATION, "version": "1", "batch": BATCH, "result": "PASSED", **changes}
    arn = f"arn:aws:robomaker:us-west-2:123456789012:robot-application/{said['application']}/1700000000000"
    subject = {
        "name": "courier/1/any",
        "digest": {"sha256": sha256_of(packed)},
        "annotations": {"application": arn, "version": said["version"], "architecture": None, "simulated": True},
    }
    return {
        "_type": said.get("type", "https://in-toto.io/Statement/v1"),
        "subject": [subject],
        "predicateType": said.get("predicate", "https://in-toto.io/attestation/test-result/v0.1"),
        "predicate": {"result": said["result"], "configuration": [{"uri": said["batch"]}], "passedTests": ["sim-1"]},
    }


def envelope(said: Mapping[str, Any], key: CryptoSigner, kind: str = KIND, keyid: str | None = None) -> bytes:
    """A signed statement."""
    payload = json.dumps(said).encode()
    signature = key.sign(b"DSSEv1 %d %s %d %s" % (len(kind), kind.encode(), len(payload), payload))
    signed = {"keyid": keyid or signature.keyid, "sig": base64.b64encode(bytes.fromhex(signature.signature)).decode()}
    return json.dumps(
        {"payload": base64.b64encode(payload).decode(), "payloadType": kind, "signatures": [signed]}
    ).encode()


@dataclass
class Fleet:
    """A robot whose root names a key for attestations, and a server that has all keys but this and the root's."""

    robot: Robot
    key: CryptoSigner = field(default_factory=CryptoSigner.generate_ed25519)
    jobs: int = 0

    def name_key(self, *keys: CryptoSigner, applications: tuple[str, ...] = ("*",)) -> None:
        """Makes the next root name keys, and applications that need an attestation."""
        named = {each.public_key.keyid: each.public_key.to_dict() for each in keys or (self.key,)}
        repository = self.robot.repository
        repository.attested = {"keys": named, "applications": list(applications)}
        repository.new_root()

    def publish(self, *envelopes: bytes, packed: bytes = PACKED, **members: Any) -> str:
        """Publishes a deployment with attestations; returns its target."""
        self.jobs += 1
        repository = self.robot.repository
        folder = f"applications/{APPLICATION}/attestations"
        paths = [repository.add(f"{folder}/{sha256_of(each)}.json", each) for each in envelopes]
        return repository.add_deployment(
            f"job-{self.jobs}", packed, **{"attestations": paths, "batch": BATCH, **members}
        )

    def refuses(self, *envelopes: bytes, **members: Any) -> str:
        """Why the robot refuses a deployment."""
        error = refused(self.robot, self.publish(*envelopes, **members))
        assert error.code == "RobotDeploymentAborted"
        return error.reason


@pytest.fixture
def fleet(robot: Robot) -> Fleet:
    fleet = Fleet(robot)
    fleet.name_key()
    return fleet


def test_what_was_attested_is_installed(fleet: Fleet) -> None:
    right = envelope(statement(), fleet.key)
    assert fleet.robot.install(fleet.publish(right)) == PACKED
    assert fleet.robot.install(fleet.publish(right, batch=None)) == PACKED
    assert fleet.robot.install(fleet.publish(envelope(statement(OTHER), fleet.key), right)) == PACKED


@pytest.mark.parametrize("members", [{}, {"batch": None}, {"batch": None, "attestations": None}])
def test_a_missing_attestation_is_missed(fleet: Fleet, members: dict[str, Any]) -> None:
    """The server may leave out that a batch is required: the root says that one is."""
    expected = "AttestationError: version 1 of courier was not attested: the deployment has no attestation"
    assert fleet.refuses(**members) == expected


def test_an_attestation_that_is_named_and_not_there_is_missed(fleet: Fleet) -> None:
    path = f"applications/{APPLICATION}/attestations/none.json"
    assert refused(fleet.robot, fleet.publish(attestations=[path])).code == "ResourceNotFound"


def test_an_attestation_of_another_archive_does_not_count(fleet: Fleet) -> None:
    reason = fleet.refuses(envelope(statement(), fleet.key), packed=OTHER)
    assert f"is not about the archive with SHA-256 {sha256_of(OTHER)}, but {sha256_of(PACKED)}" in reason


def test_the_key_of_somebody_else_does_not_count(fleet: Fleet) -> None:
    thief = CryptoSigner.generate_ed25519()
    assert "is not signed by a key that the root names" in fleet.refuses(envelope(statement(), thief))
    forged = envelope(statement(), thief, keyid=fleet.key.public_key.keyid)
    assert "is not signed by a key that the root names" in fleet.refuses(forged)


def test_the_keys_of_the_repository_do_not_count(fleet: Fleet) -> None:
    for role, key in fleet.robot.repository.signers.items():
        assert "is not signed by a key that the root names" in fleet.refuses(envelope(statement(), key)), role


def test_what_was_changed_after_it_was_signed_does_not_count(fleet: Fleet) -> None:
    content = json.loads(envelope(statement(), fleet.key))
    content["payload"] = base64.b64encode(json.dumps(statement(OTHER)).encode()).decode()
    assert "is not signed by" in fleet.refuses(json.dumps(content).encode(), packed=OTHER)


@pytest.mark.parametrize(
    ("said", "reason"),
    [
        ({"version": "0"}, "but about other versions"),
        ({"application": "guard"}, "but about other versions"),
        ({"batch": f"{BATCH}0"}, f"is about {BATCH}0, and {BATCH} is required"),
        ({"result": "FAILED"}, "has the result 'FAILED'"),
        ({"type": "https://in-toto.io/Statement/v0.1"}, "is no statement of a test result, but "),
        ({"predicate": "https://slsa.dev/provenance/v1"}, "is no statement of a test result, but "),
    ],
)
def test_an_old_or_other_statement_of_the_same_archive_does_not_count(
    fleet: Fleet, said: dict[str, str], reason: str
) -> None:
    assert reason in fleet.refuses(envelope(statement(PACKED, **said), fleet.key))


@pytest.mark.parametrize(
    "said", [{}, {"subject": 1}, {**statement(), "subject": [{}]}, {**statement(), "predicate": []}]
)
def test_a_statement_without_form_is_refused_and_breaks_nothing(fleet: Fleet, said: dict[str, Any]) -> None:
    assert "is no statement of a test result: " in fleet.refuses(envelope(said, fleet.key))


@pytest.mark.parametrize("content", [b"", b"[]", b"{}", b'{"payload": "=", "payloadType": "", "signatures": []}'])
def test_what_is_no_envelope_is_refused(fleet: Fleet, content: bytes) -> None:
    assert "is not signed by a key that the root names" in fleet.refuses(content)


def test_a_payload_of_another_kind_is_refused(fleet: Fleet) -> None:
    assert "is no statement of a test result, but " in fleet.refuses(envelope(statement(), fleet.key, kind="text/json"))


def test_a_root_decides_whose_attestations_count_from_then_on(fleet: Fleet) -> None:
    old, new = envelope(statement(), fleet.key), CryptoSigner.generate_ed25519()
    fleet.robot.install(fleet.publish(old))
    fleet.name_key(new)
    assert "is not signed by a key that the root names" in fleet.refuses(old)
    assert fleet.robot.install(fleet.publish(envelope(statement(), new))) == PACKED


def test_a_server_cannot_make_a_root_that_asks_for_less(fleet: Fleet) -> None:
    fleet.robot.install(fleet.publish(envelope(statement(), fleet.key)))
    repository = fleet.robot.repository
    repository.signers["root"] = CryptoSigner.generate_ed25519()  # it has not the right one
    repository.attested = None
    repository.new_root()
    assert "UnsignedMetadataError" in fleet.refuses(packed=OTHER, batch=None)


def test_a_deployment_that_requires_a_batch_needs_its_attestation_also_where_the_root_asks_none(fleet: Fleet) -> None:
    fleet.name_key(applications=("guard",))
    assert "the deployment has no attestation" in fleet.refuses()
    assert fleet.robot.install(fleet.publish(batch=None)) == PACKED
    assert fleet.robot.install(fleet.publish(envelope(statement(), fleet.key))) == PACKED


def test_a_root_from_before_attestations_names_no_key_and_asks_for_none(robot: Robot) -> None:
    assert robot.install(Fleet(robot).publish()) == PACKED


@pytest.mark.parametrize("content", [[], {"keys": {}}, {"keys": {"a": 1}, "applications": ["*"]}])
def test_a_root_of_another_form_lets_nothing_in(fleet: Fleet, content: Any) -> None:
    fleet.robot.repository.attested = content
    fleet.robot.repository.new_root()
    assert fleet.refuses(envelope(statement(), fleet.key)).startswith("AttestationError: ")
