"""Attestations: what they say, who signed them, and that nothing of them can be changed."""

import base64
import hashlib
import json
import stat
import threading
from typing import Any

import pytest
from cryptography.hazmat.primitives.asymmetric.ec import SECP256R1, generate_private_key
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
    PublicFormat,
    load_pem_public_key,
)
from helpers.examples import examples
from helpers.tested_batches import WORLD, Batches, courier, etag
from hypothesis import HealthCheck, given
from hypothesis import strategies as st

from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.schemas.wire.errors import AttestationError, ConfigurationError, DeploymentError
from prefect_robomaker.tasks.catalog import Resource
from prefect_robomaker.tasks.fleet.attestations.envelopes import (
    PublicKey,
    attestation_key,
    known_public_key,
    public_key_path,
    read_public_key,
    verified,
)
from prefect_robomaker.tasks.fleet.attestations.passed_batch import PassedBatch, StoredBatch, judge
from prefect_robomaker.tasks.fleet.attestations.required_batches import signed
from prefect_robomaker.tasks.service.service import Service

ARCHIVES = {"x86": "X86_64", "arm": "ARM64"}


@pytest.fixture
def application(service: Service) -> Resource:
    return courier(service, **ARCHIVES)


@pytest.fixture
def batch(service: Service, application: Resource) -> PassedBatch:
    batches = Batches(service, etag(service, "x86"))
    found = judge(StoredBatch.of(batches.batch({}, {}), service), application)
    assert isinstance(found, PassedBatch)
    return found


@pytest.fixture
def envelope(service: Service, application: Resource, batch: PassedBatch) -> bytes:
    return signed(batch, application, service)


def payload(envelope: bytes) -> dict[str, Any]:
    return json.loads(base64.b64decode(json.loads(envelope)["payload"]))


def test_the_statement_has_the_published_form(
    envelope: bytes, batch: PassedBatch, application: Resource, service: Service
) -> None:
    statement = payload(envelope)

    assert statement.keys() == {"_type", "subject", "predicateType", "predicate"}
    assert statement["_type"] == "https://in-toto.io/Statement/v1"
    assert statement["predicateType"] == "https://in-toto.io/attestation/test-result/v0.1"
    assert {each["name"]: each["digest"] for each in statement["subject"]} == {
        f"courier/1/{architecture}": {"sha256": hashlib.sha256(f"archive {key}".encode()).hexdigest()}
        for key, architecture in ARCHIVES.items()
    }
    assert [each["annotations"]["simulated"] for each in statement["subject"]] == [True, False]
    assert statement["subject"][0]["annotations"]["application"] == application.arn
    predicate = statement["predicate"]
    assert predicate.keys() == {"result", "configuration", "passedTests", "warnedTests", "failedTests"}
    assert predicate["result"] == "PASSED"
    assert predicate["passedTests"] == [job.id for job in batch.jobs]
    assert predicate["warnedTests"] == predicate["failedTests"] == []
    (configuration,) = predicate["configuration"]
    assert configuration["uri"] == batch.arn
    request = service.catalog.get(batch.arn).document["request"]
    canonical = json.dumps(request, sort_keys=True, separators=(",", ":")).encode()
    assert configuration["digest"] == {"sha256": hashlib.sha256(canonical).hexdigest()}
    assert WORLD in canonical.decode()
    facts = {"jobs": 2, "seeds": 2, "trials": 0, "worlds": 1, "requirements": ["arrives"]}
    assert configuration["annotations"] == facts


def test_the_envelope_is_dsse_and_any_program_can_verify_it(envelope: bytes, service: Service) -> None:
    parts = json.loads(envelope)
    assert parts.keys() == {"payload", "payloadType", "signatures"}
    assert parts["payloadType"] == "application/vnd.in-toto+json"
    kind, content = parts["payloadType"].encode(), base64.b64decode(parts["payload"])
    message = b"DSSEv1 %d %s %d %s" % (len(kind), kind, len(content), content)
    public: Any = load_pem_public_key(public_key_path(service).read_bytes())

    public.verify(base64.b64decode(parts["signatures"][0]["sig"]), message)


def test_the_same_is_attested_in_the_same_bytes(
    envelope: bytes, service: Service, application: Resource, batch: PassedBatch
) -> None:
    assert signed(batch, application, service) == envelope
    assert verified(envelope, known_public_key(service)).batch.uri == batch.arn


@examples(300, suppress_health_check=(HealthCheck.function_scoped_fixture,))
@given(data=st.data())
def test_no_byte_of_it_can_be_changed(envelope: bytes, service: Service, data: st.DataObject) -> None:
    place = data.draw(st.integers(0, len(envelope) - 1))
    byte = data.draw(st.integers(0, 255).filter(lambda byte: byte != envelope[place]))

    with pytest.raises(AttestationError):
        verified(envelope[:place] + bytes([byte]) + envelope[place + 1 :], known_public_key(service))


@pytest.mark.parametrize(
    "other",
    [
        lambda envelope: b"",
        lambda envelope: b"[]",
        lambda envelope: b"[" * 10_000,
        lambda envelope: envelope + b"\n",
        lambda envelope: json.dumps(json.loads(envelope), indent=2).encode(),
        lambda envelope: json.dumps({**json.loads(envelope), "signatures": []}, separators=(",", ":")).encode(),
        lambda envelope: envelope.replace(b'"payloadType"', b'"payload":"","payloadType"'),
    ],
)
def test_what_is_no_envelope_of_ours_is_refused(envelope: bytes, service: Service, other: Any) -> None:
    with pytest.raises(AttestationError):
        verified(other(envelope), known_public_key(service))


def test_another_key_is_refused(envelope: bytes, settings_of_another: Settings) -> None:
    other = attestation_key(Service.open(settings_of_another, {})).public_key
    assert isinstance(other, PublicKey)

    with pytest.raises(AttestationError, match=f"not by {other.keyid}"):
        verified(envelope, other)


def test_a_forger_who_names_our_key_is_refused(
    envelope: bytes, service: Service, settings_of_another: Settings
) -> None:
    forger = attestation_key(Service.open(settings_of_another, {}))
    parts = json.loads(envelope)
    kind, content = parts["payloadType"].encode(), base64.b64decode(parts["payload"])
    forged = forger.sign(b"DSSEv1 %d %s %d %s" % (len(kind), kind, len(content), content)).to_dict()["sig"]
    parts["signatures"][0]["sig"] = base64.b64encode(bytes.fromhex(forged)).decode()

    with pytest.raises(AttestationError, match="signature is wrong"):
        verified(json.dumps(parts, sort_keys=True, separators=(",", ":")).encode(), known_public_key(service))


@pytest.fixture
def settings_of_another(tmp_path: Any) -> Settings:
    return Settings.from_environment({"ROBOMAKER_HOME": str(tmp_path / "another")})


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (lambda store: store.delete("apps", "arm"), "ResourceNotFound"),
        (lambda store: store.put_bytes("apps", "arm", b"another"), "EtagMismatch"),
    ],
)
def test_nothing_is_attested_of_an_archive_that_has_changed(
    service: Service, application: Resource, batch: PassedBatch, change: Any, code: str
) -> None:
    change(service.store)

    with pytest.raises(DeploymentError, match="s3://apps/arm ") as refused:
        signed(batch, application, service)

    assert refused.value.failure_code == code


def test_all_who_need_the_first_key_at_once_get_the_same(service: Service) -> None:
    found: list[str] = []
    threads = [
        threading.Thread(target=lambda: found.append(attestation_key(service).public_key.keyid)) for _ in range(8)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()

    assert len(found) == 8
    assert set(found) == {read_public_key(public_key_path(service)).keyid}


def test_only_its_user_reads_the_key(service: Service) -> None:
    with pytest.raises(ConfigurationError, match=r"there is no attestation key .* --public-key"):
        known_public_key(service)
    attestation_key(service)

    path = service.folder("robots") / "attestation-key"
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert not (service.folder("robots") / "signing-key.pem").exists(), "it is no key of deployments"

    path.write_bytes(b"nothing")
    with pytest.raises(ConfigurationError, match=r"attestation-key is no private key in PEM"):
        attestation_key(service)


def test_keys_of_other_kinds_are_refused(service: Service) -> None:
    other = generate_private_key(SECP256R1())
    private, public = service.folder("robots") / "attestation-key", service.folder("robots") / "other.pub"
    private.write_bytes(other.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()))
    public.write_bytes(other.public_key().public_bytes(Encoding.PEM, PublicFormat.SubjectPublicKeyInfo))

    with pytest.raises(ConfigurationError, match="of another kind; attestations are signed with ed25519"):
        attestation_key(service)
    with pytest.raises(ConfigurationError, match="of another kind; attestations are signed with ed25519"):
        read_public_key(public)
    with pytest.raises(ConfigurationError, match=r"missing cannot be read: No such file"):
        read_public_key(service.folder("robots") / "missing")
    public.write_bytes(b"nothing")
    with pytest.raises(ConfigurationError, match=r"other\.pub is no public key in PEM"):
        read_public_key(public)
