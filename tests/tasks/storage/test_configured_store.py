"""Settings to stores."""

from pathlib import Path

import pytest
from helpers.s3_server import S3Server

from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.schemas.wire.errors import ConfigurationError
from prefect_robomaker.tasks.storage import open_store
from prefect_robomaker.tasks.storage.directory import DirectoryStore


def settings(place: str, home: Path) -> Settings:
    return Settings.from_environment({"ROBOMAKER_HOME": str(home), "ROBOMAKER_OBJECT_STORE": place})


def test_a_folder_becomes_a_directory_store(tmp_path: Path):
    store = open_store(settings(str(tmp_path / "here"), tmp_path), {})
    assert isinstance(store, DirectoryStore)
    assert store.local_path("bucket", "key") == tmp_path / "here" / "bucket" / "key"
    assert not (tmp_path / "here").exists(), "opening writes nothing"


def test_an_endpoint_becomes_an_s3_store_with_the_given_credentials(s3_server: S3Server, tmp_path: Path):
    environ = s3_server.environ()
    store = open_store(settings(environ["ROBOMAKER_OBJECT_STORE"] + "/", tmp_path), environ)
    store.ensure_bucket("opened")
    store.put_bytes("opened", "key", b"content")
    assert s3_server.client("s3").get_object(Bucket="opened", Key="key")["Body"].read() == b"content"


def test_aws_needs_no_endpoint(tmp_path: Path):
    store = open_store(settings("aws", tmp_path), {"AWS_ACCESS_KEY_ID": "key", "AWS_SECRET_ACCESS_KEY": "secret"})
    assert store.uri("bucket", "key") == "s3://bucket/key"


@pytest.mark.parametrize(
    "place",
    ["ftp://host", "s3://bucket", "file:///tmp", "http://", "http://host/path", "http://host?x=1", "http://host:port"],
)
def test_other_urls_are_refused_with_what_would_be_right(place: str, tmp_path: Path):
    with pytest.raises(ConfigurationError, match="ROBOMAKER_OBJECT_STORE") as caught:
        open_store(settings(place, tmp_path), {})
    assert place in str(caught.value)


def test_a_password_in_the_url_is_not_repeated(tmp_path: Path):
    with pytest.raises(ConfigurationError, match="AWS_SECRET_ACCESS_KEY") as caught:
        open_store(settings("http://user:hunter2@host", tmp_path), {})
    assert "hunter2" not in str(caught.value)


@pytest.mark.parametrize("given", ["AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"])
def test_half_a_pair_of_keys_is_refused(given: str, tmp_path: Path):
    with pytest.raises(ConfigurationError, match=f"{given} is set but"):
        open_store(settings("aws", tmp_path), {given: "value"})


def test_an_unknown_profile_is_refused(tmp_path: Path):
    with pytest.raises(ConfigurationError, match="nobody"):
        open_store(settings("aws", tmp_path), {"AWS_PROFILE": "nobody"})
