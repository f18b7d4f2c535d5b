import random

import pytest

from prefect_robomaker.tasks.fleet.ddi.robot_tokens import hash_token, is_token, new_token, token_in


def test_a_token_is_what_updaters_can_be_given() -> None:
    token = new_token(random.Random(1).randbytes)

    assert token.isalnum()
    assert len(token) == 64
    assert token != new_token(random.Random(2).randbytes)


def test_the_hash_of_a_token_knows_it_again() -> None:
    kept = hash_token("secret")

    assert is_token(b"secret", kept)
    assert not is_token(b"secret2", kept)
    assert b"secret" not in kept


@pytest.mark.parametrize(
    ("header", "token"),
    [
        (b"TargetToken abc", b"abc"),
        (b"targettoken  abc ", b"abc"),
        (b"TargetToken " + b"a" * 128, b"a" * 128),
        (b"TargetToken " + b"a" * 129, None),
        (b"TargetToken", None),
        (b"TargetToken ", None),
        (b"GatewayToken abc", None),
        (b"Bearer abc", None),
        (b"", None),
        (None, None),
    ],
)
def test_only_target_tokens_count(header: bytes | None, token: bytes | None) -> None:
    assert token_in(header) == token
