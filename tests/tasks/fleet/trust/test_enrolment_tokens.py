"""One-time tokens let an agent in once, in time, and tell it whom to trust."""

import hashlib
import secrets
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import pytest
from helpers.fleet_calls import Fleets

from prefect_robomaker.schemas.fleet.documents import RobotDocument
from prefect_robomaker.schemas.wire.errors import InvalidParameterException
from prefect_robomaker.tasks.fleet.ddi.robot_tokens import hash_token
from prefect_robomaker.tasks.fleet.fleet_records import enrol, enrollable
from prefect_robomaker.tasks.fleet.trust.ceremonies import renew_root
from prefect_robomaker.tasks.fleet.trust.enrolment_tokens import VALID_S, offer, take
from prefect_robomaker.tasks.fleet.trust.publishing import publisher_of
from prefect_robomaker.tasks.service.service import Service

MINE, ANOTHER = hash_token("mine").hex(), hash_token("another").hex()


@pytest.fixture
def rover(service: Service) -> str:
    return Fleets(service).robot("rover")


def offered(service: Service, *, rotate: bool = False) -> tuple[str, str]:
    """The two halves of a new one-time token."""
    token = offer(enrollable("rover", service), service, secrets.token_bytes, rotate=rotate)
    secret, _, root = token.text.partition("-")
    return secret, root


def document(service: Service, arn: str) -> RobotDocument:
    return RobotDocument.of(service.catalog.get(arn))


def later(service: Service, duration_s: float) -> Service:
    now = datetime.now(UTC) + timedelta(seconds=duration_s)
    return replace(service, clock=lambda: now)


def test_an_agent_is_let_in_and_told_whom_to_trust(service: Service, rover: str) -> None:
    secret, root_sha256 = offered(service)
    assert len(secret) == 40
    assert secret.isalnum()
    assert document(service, rover).has_agent, "nothing else runs on it"

    root = take("rover", secret, MINE, service)

    assert root is not None
    assert hashlib.sha256(root.encode()).hexdigest() == root_sha256
    known = document(service, rover)
    assert (known.kind, known.token_sha256) == ("agent", MINE)
    assert secret not in str(known), "only hashes are stored"


def test_the_same_body_is_answered_again_and_another_is_not(service: Service, rover: str) -> None:
    secret, _ = offered(service)
    first = take("rover", secret, MINE, service)
    assert take("rover", secret, MINE, service) == first
    assert take("rover", secret, ANOTHER, service) is None
    assert document(service, rover).token_sha256 == MINE


def test_a_token_is_taken_for_an_hour(service: Service, rover: str) -> None:
    secret, _ = offered(service)
    assert take("rover", secret, MINE, later(service, VALID_S + 1)) is None
    assert document(service, rover).token_sha256 is None
    assert take("rover", secret, MINE, later(service, VALID_S - 60)) is not None
    assert take("rover", secret, MINE, later(service, VALID_S + 1)) is None


def test_wrong_tokens_and_names_let_no_one_in(service: Service, rover: str) -> None:
    secret, _ = offered(service)
    assert take("rover", "0" * 40, MINE, service) is None
    assert take("nobody", secret, MINE, service) is None
    Fleets(service).robot("other")
    assert take("other", secret, MINE, service) is None
    with pytest.raises(InvalidParameterException, match=r"tokenSha256: 'x' is not right; 64"):
        take("rover", secret, "x", service)
    newer, _ = offered(service)
    assert take("rover", secret, MINE, service) is None, "a newer one takes its place"
    assert take("rover", newer, MINE, service) is not None


def test_the_root_is_the_one_that_the_token_names_also_after_a_newer_one(service: Service, rover: str) -> None:
    secret, root_sha256 = offered(service)
    renew_root(publisher_of(service), ["timestamp"], [], None)

    root = take("rover", secret, MINE, service)

    assert root is not None
    assert hashlib.sha256(root.encode()).hexdigest() == root_sha256


def test_an_updater_stays_until_the_agent_has_come(service: Service, rover: str) -> None:
    token = enrol("rover", service, secrets.token_bytes, rotate=False)
    with pytest.raises(InvalidParameterException, match=r"has a token already; --rotate replaces it as soon as"):
        offered(service)
    secret, _ = offered(service, rotate=True)
    known = document(service, rover)
    assert (known.has_agent, known.token_sha256) == (False, hash_token(token).hex())

    take("rover", secret, MINE, service)
    assert document(service, rover).has_agent

    enrol("rover", service, secrets.token_bytes, rotate=True)
    known = document(service, rover)
    assert not known.has_agent
    assert take("rover", secret, MINE, service) is None, "the one-time token went with the agent"
