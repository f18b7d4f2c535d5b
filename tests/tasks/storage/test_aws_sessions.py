"""Sessions share what botocore knows of services, and nothing else."""

from pathlib import Path

import pytest
from botocore.exceptions import ProfileNotFound
from botocore.loaders import JSONFileLoader

from prefect_robomaker.tasks.storage.aws_sessions import new_session
from prefect_robomaker.tasks.storage.s3 import S3Store


def test_a_second_store_reads_nothing_that_the_first_has_read(monkeypatch: pytest.MonkeyPatch) -> None:
    S3Store("http://127.0.0.1:9", "us-east-1", new_session("key", "secret"))
    read: list[str] = []
    original = JSONFileLoader.load_file

    def note(self: JSONFileLoader, file_path: str) -> object:
        read.append(file_path)
        return original(self, file_path)

    monkeypatch.setattr(JSONFileLoader, "load_file", note)
    S3Store("http://127.0.0.1:9", "us-east-1", new_session("other", "secret"))

    assert read == []


def test_each_session_has_its_own_credentials() -> None:
    found = [new_session(key, "secret", f"{key}-token").get_credentials() for key in ("one", "two")]

    assert [(each.access_key, each.token) for each in found if each] == [("one", "one-token"), ("two", "two-token")]


def test_a_profile_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "credentials").write_text("[lab]\naws_access_key_id = of-lab\naws_secret_access_key = secret\n")
    monkeypatch.setenv("AWS_SHARED_CREDENTIALS_FILE", str(tmp_path / "credentials"))
    credentials = new_session(profile_name="lab").get_credentials()

    assert credentials is not None
    assert credentials.access_key == "of-lab"


def test_a_profile_that_is_not_there_is_an_error() -> None:
    with pytest.raises(ProfileNotFound, match="nobody"):
        new_session(profile_name="nobody")


def test_models_of_ones_own_are_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    new_session("key", "secret")
    (tmp_path / "mine" / "2026-01-01").mkdir(parents=True)
    (tmp_path / "mine" / "2026-01-01" / "service-2.json").write_text("{}")
    monkeypatch.setenv("AWS_DATA_PATH", str(tmp_path))

    assert "mine" in new_session("key", "secret").get_available_services()
