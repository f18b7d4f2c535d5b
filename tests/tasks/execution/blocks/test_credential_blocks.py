"""Credentials that are a block of Prefect, read from a real server."""

from uuid import uuid4

from prefect.blocks.core import Block
from pydantic import SecretStr

from prefect_robomaker.tasks.execution.credential_blocks import read_credential_block


class NightlyCredentials(Block):
    """What prefect-aws's credentials keep."""

    _block_type_slug = "nightly-credentials"

    aws_access_key_id: str
    aws_secret_access_key: SecretStr


def test_a_block_is_read_with_its_secret(prefect_server: str) -> None:
    name = f"nightly-{uuid4().hex[:8]}"
    saved = NightlyCredentials(aws_access_key_id="AKNIGHT", aws_secret_access_key=SecretStr("made up"))
    saved.save(name)

    found = read_credential_block("nightly-credentials", name)

    assert found is not None
    assert (found["aws_access_key_id"], found["aws_secret_access_key"]) == ("AKNIGHT", "made up")


def test_a_block_that_is_not_there_is_none(prefect_server: str) -> None:
    assert read_credential_block("nightly-credentials", f"none-{uuid4().hex[:8]}") is None
