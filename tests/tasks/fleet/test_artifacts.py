"""What robots download: made once, signed, from the very archive that the version was made of."""

import hashlib
import stat
import threading
from pathlib import Path

import pytest
from helpers.fleet_calls import Fleets

from prefect_robomaker.schemas.fleet.rollouts.rollout_plan import Artifact
from prefect_robomaker.schemas.wire.errors import ConfigurationError, DeploymentError
from prefect_robomaker.tasks.catalog import Resource
from prefect_robomaker.tasks.fleet.artifacts import certificate_path, prepare, signing_key
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.simulations.planning.applications import find_application

SUITE = {"name": "General"}


def stored(service: Service, **archives: str | None) -> Resource:
    """Version 1 of an application with archives by key, and what each is for."""
    service.store.ensure_bucket("applications")
    sources = []
    for key, architecture in archives.items():
        service.store.put_bytes("applications", key, f"archive {key}".encode())
        source = {"s3Bucket": "applications", "s3Key": key}
        sources.append(source if architecture is None else {**source, "architecture": architecture})
    application = Fleets(service).call(
        "CreateRobotApplication", name="courier", sources=sources, robotSoftwareSuite=SUITE
    )
    Fleets(service).call("CreateRobotApplicationVersion", application=application["arn"])
    return find_application("courier", "robot", "1", service)


def content(artifact: Artifact, service: Service) -> bytes:
    return service.store.get_bytes(artifact.bucket, artifact.key)


def test_each_architecture_gets_its_own_archive(service: Service) -> None:
    application = stored(service, x86="X86_64", arm="ARM64")

    made = prepare(application, ["X86_64", "ARM64", "ARMHF", "X86_64"], service)

    assert list(made) == ["ARM64", "X86_64"]
    for key, architecture in {"x86": "X86_64", "arm": "ARM64"}.items():
        artifact = made[architecture]
        file = content(artifact, service)
        assert b"archive " + key.encode() in file
        assert b"/opt/robomaker/courier/1" in file
        assert (artifact.size_bytes, artifact.sha256) == (len(file), hashlib.sha256(file).hexdigest())
        assert (artifact.name, artifact.version) == ("courier", "1")


def test_an_archive_for_any_architecture_serves_all(service: Service) -> None:
    made = prepare(stored(service, any=None), ["ARM64", "X86_64"], service)

    assert made["ARM64"] == made["X86_64"]


def test_a_file_is_made_once_and_again_when_it_is_lost(service: Service) -> None:
    application = stored(service, any=None)
    (first,) = prepare(application, ["ARM64"], service).values()
    (second,) = prepare(application, ["ARM64"], service).values()
    assert second == first, "signatures differ each time, so this one was not made again"

    service.store.delete(first.bucket, first.key)

    (third,) = prepare(application, ["ARM64"], service).values()
    assert content(third, service)


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (lambda store: store.delete("applications", "any"), "ResourceNotFound"),
        (lambda store: store.put_bytes("applications", "any", b"another"), "EtagMismatch"),
    ],
)
def test_an_archive_that_is_not_there_any_more_is_named(service: Service, change, code: str) -> None:
    application = stored(service, any=None)
    change(service.store)

    with pytest.raises(DeploymentError, match=r"s3://applications/any ") as refused:
        prepare(application, ["ARM64"], service)

    assert refused.value.failure_code == code


def test_an_application_without_archives_cannot_be_deployed(service: Service) -> None:
    environment = {"uri": "python://courier"}
    made = Fleets(service).call(
        "CreateRobotApplication", name="courier", environment=environment, robotSoftwareSuite=SUITE
    )
    Fleets(service).call("CreateRobotApplicationVersion", application=made["arn"])

    with pytest.raises(DeploymentError, match="give its version sources") as refused:
        prepare(find_application("courier", "robot", "1", service), ["ARM64"], service)

    assert refused.value.failure_code == "MissingRobotDeploymentResource"


def test_all_who_need_the_first_key_at_once_get_the_same(service: Service) -> None:
    keys = []
    threads = [threading.Thread(target=lambda: keys.append(signing_key(service).private_pem)) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()

    assert len(keys) == 8
    assert len(set(keys)) == 1
    assert certificate_path(service).read_bytes() == signing_key(service).certificate_pem


def test_only_its_user_reads_the_key_and_a_damaged_one_is_named(service: Service) -> None:
    signing_key(service)
    path = Path(service.settings.home, "robots", "signing-key.pem")
    assert stat.S_IMODE(path.stat().st_mode) == 0o600

    path.write_bytes(b"nothing")

    with pytest.raises(ConfigurationError, match=r"signing-key\.pem: the signing key is no private key"):
        signing_key(service)
