"""What runs get from their work pool: variables given by hand and by blocks."""

from collections.abc import Mapping
from typing import Any

import pytest

from prefect_robomaker.deployments.deploying.job_variables import environment_of_blocks, environment_of_words
from prefect_robomaker.schemas.wire.errors import ConfigurationError

BLOCKS: dict[tuple[str, str], Mapping[str, Any]] = {
    ("robomaker-object-store", "lab"): {"address": "http://s3:9000", "bucket": None, "credentials": None},
    ("robomaker-object-store", "shared"): {
        "address": "aws",
        "bucket": "runs",
        "credentials": {"aws_access_key_id": "id", "aws_secret_access_key": "********"},
    },
    ("minio-credentials", "lab"): {"minio_root_user": "root", "minio_root_password": "********"},
}


def read(slug: str, name: str) -> Mapping[str, Any] | None:
    return BLOCKS.get((slug, name))


def test_variables_are_names_and_values() -> None:
    assert environment_of_words(["A=1", "ROBOMAKER_HOME=/data=x", "B="]) == {
        "A": "1",
        "ROBOMAKER_HOME": "/data=x",
        "B": "",
    }


@pytest.mark.parametrize("word", ["A", "=1", "1A=1", "A B=1"])
def test_a_word_that_is_no_variable_is_named(word: str) -> None:
    with pytest.raises(ConfigurationError, match=f"--env is '{word}'; NAME=VALUE would be right"):
        environment_of_words([word])


def test_a_block_gives_references_to_what_it_has_and_no_secret() -> None:
    assert environment_of_blocks(["robomaker-object-store/lab", "minio-credentials/lab"], read) == {
        "ROBOMAKER_OBJECT_STORE": "{{ prefect.blocks.robomaker-object-store.lab.address }}",
        "AWS_ACCESS_KEY_ID": "{{ prefect.blocks.minio-credentials.lab.minio_root_user }}",
        "AWS_SECRET_ACCESS_KEY": "{{ prefect.blocks.minio-credentials.lab.minio_root_password }}",
    }


def test_credentials_within_a_store_are_taken() -> None:
    found = environment_of_blocks(["robomaker-object-store/shared"], read)

    assert found["ROBOMAKER_BUCKET"] == "{{ prefect.blocks.robomaker-object-store.shared.bucket }}"
    assert (
        found["AWS_SECRET_ACCESS_KEY"]
        == "{{ prefect.blocks.robomaker-object-store.shared.credentials.aws_secret_access_key }}"
    )
    assert "AWS_SESSION_TOKEN" not in found


@pytest.mark.parametrize(
    ("word", "advice"),
    [
        ("robomaker-object-stor/lab", "did you mean 'robomaker-object-store'"),
        ("secret/x", "TYPE is one of robomaker-object-store, "),
        ("robomaker-catalog", "TYPE/NAME would be right"),
        ("robomaker-catalog/lab", "no such block: `prefect block ls`"),
    ],
)
def test_a_block_that_cannot_be_used_is_named(word: str, advice: str) -> None:
    with pytest.raises(ConfigurationError, match=advice) as raised:
        environment_of_blocks([word], read)
    assert f"--block is '{word}'" in str(raised.value)
