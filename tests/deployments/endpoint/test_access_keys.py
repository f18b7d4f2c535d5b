from pathlib import Path

import pytest

from prefect_robomaker.deployments.endpoint.access_keys import read_access_keys
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

    assert read_access_keys(path) == {"AKIA1": SECRET, "AKIA2": "two"}
    assert caplog.text == ""


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
