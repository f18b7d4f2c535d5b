from pathlib import Path

import pytest

from prefect_robomaker.deployments.endpoint.calling.access_keys import AccessKey, read_access_keys
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.schemas.wire.errors import ConfigurationError

SECRET = "wJalr%XUtn#FEMI/K7;MDENG=bPx"  # what a parser might take for something else


def write(folder: Path, text: str) -> Path:
    path = folder / "keys"
    path.write_text(text)
    path.chmod(0o600)
    return path


def test_every_pair_of_keys_counts(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = write(
        tmp_path,
        f"# people\n[alice]\naws_access_key_id = AKIA1\naws_secret_access_key = {SECRET}\nregion = us-east-1\n"
        "[profile bob]\naws_access_key_id=AKIA2\naws_secret_access_key=two\n[empty]\nregion = us-east-1\n",
    )

    assert read_access_keys(path) == {
        "AKIA1": AccessKey("AKIA1", SECRET, "alice"),
        "AKIA2": AccessKey("AKIA2", "two", "bob"),
    }
    assert SECRET not in repr(read_access_keys(path))
    assert caplog.text == ""


def test_what_a_key_is_good_for(tmp_path: Path) -> None:
    pair = "aws_access_key_id = AKIA1\naws_secret_access_key = one\n"
    limits = "robomaker_scope = submit\nrobomaker_names = nightly-, ci-\nrobomaker_tags = team=red\n"

    key = read_access_keys(write(tmp_path, f"[ci]\n{pair}{limits}"))["AKIA1"]

    assert key == AccessKey("AKIA1", "one", "ci", "submit", ("nightly-", "ci-"), ("team=red",))


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("robomaker_scope = all", "robomaker_scope = all; it has to be one of read, submit, administer"),
        ("robomaker_scopes = read", "has robomaker_scopes.*robomaker_scope"),
        ("robomaker_names =", "robomaker_names without a value"),
        ("robomaker_tags = ,", "robomaker_tags without a value"),
    ],
)
def test_a_limit_that_is_not_understood_opens_nothing(tmp_path: Path, line: str, words: str) -> None:
    with pytest.raises(ConfigurationError, match=words):
        read_access_keys(write(tmp_path, f"[ci]\naws_access_key_id = A\naws_secret_access_key = b\n{line}\n"))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[alice]\naws_access_key_id = AKIA1\n", r"\[alice\] has only one of aws_access_key_id and"),
        ("[alice]\naws_secret_access_key = hidden\n", r"\[alice\] has only one"),
        ("[alice]\n", "it holds no keys"),
        ("AKIA1 hidden\n", "it cannot be read as one"),
        ("[alice]\nhidden\n", "it cannot be read as one"),
    ],
)
def test_a_file_that_cannot_be_used_is_named_and_not_quoted(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(ConfigurationError, match=words) as raised:
        read_access_keys(write(tmp_path, text))

    assert str(tmp_path / "keys") in str(raised.value)
    assert "hidden" not in str(raised.value)


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="nowhere': No such file"):
        read_access_keys(tmp_path / "nowhere")


def test_the_setting(tmp_path: Path) -> None:
    environ = {"ROBOMAKER_HOME": str(tmp_path)}

    assert Settings.from_environment(environ).access_keys_file is None
    given = Settings.from_environment({**environ, "ROBOMAKER_ACCESS_KEYS_FILE": "~/keys"})
    assert given.access_keys_file == Path.home() / "keys"
