"""Sessions end, cannot be guessed many times, and are those of access keys."""

import pytest

from prefect_robomaker.deployments.console.sessions import LIFETIME_S, Sessions
from prefect_robomaker.deployments.endpoint.calling.access_keys import AccessKey
from prefect_robomaker.deployments.endpoint.protocol_errors import UnrecognizedClientException
from prefect_robomaker.schemas.wire.errors import ThrottlingException

ALICE = AccessKey("AKID", "word", "alice")


class Clock:
    """A clock that a test sets."""

    now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


def test_a_session_is_its_access_keys_until_it_is_over() -> None:
    clock = Clock()
    sessions = Sessions({"AKID": ALICE}, clock)
    token = sessions.log_in("AKID", "word")

    found = sessions.find(token)
    assert found is not None
    assert found.key is ALICE
    assert found.form_token != token
    clock.now_s = LIFETIME_S
    assert sessions.find(token) is None


def test_sessions_end_when_their_visitors_log_out() -> None:
    sessions = Sessions({"AKID": ALICE}, Clock())
    first, second = sessions.log_in("AKID", "word"), sessions.log_in("AKID", "word")
    sessions.log_out(first)

    assert first != second
    assert sessions.find(first) is None
    assert sessions.find(second) is not None
    assert sessions.find(None) is None


@pytest.mark.parametrize(("key", "word"), [("AKID", "other"), ("AKID", ""), ("other", "word"), ("", "")])
def test_strangers_do_not_get_in(key: str, word: str) -> None:
    with pytest.raises(UnrecognizedClientException, match="no access key with this id and this secret"):
        Sessions({"AKID": ALICE}, Clock()).log_in(key, word)


def test_after_ten_failures_all_wait_a_minute() -> None:
    clock = Clock()
    sessions = Sessions({"AKID": ALICE}, clock)
    for _ in range(10):
        with pytest.raises(UnrecognizedClientException):
            sessions.log_in("AKID", "guess")

    with pytest.raises(ThrottlingException, match="try again in a minute"):
        sessions.log_in("AKID", "word")
    clock.now_s = 60
    assert sessions.log_in("AKID", "word")


def test_failed_logins_of_one_address_keep_no_other_out() -> None:
    sessions = Sessions({"AKID": ALICE}, Clock())
    for _ in range(20):
        with pytest.raises((UnrecognizedClientException, ThrottlingException)):
            sessions.log_in("AKID", "guess", "192.0.2.1")
    assert sessions.log_in("AKID", "word", "192.0.2.2")
