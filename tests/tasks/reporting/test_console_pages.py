"""Links to a console are printed only while it answers, and to others only those that open where they are."""

import json
import shutil
import socket
from pathlib import Path

import pytest

from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.schemas.wire.errors import ConfigurationError
from prefect_robomaker.tasks.reporting.console_pages import (
    NO_CONSOLE,
    ConsolePages,
    forget_console,
    note_console,
    pages_elsewhere,
    pages_here,
)


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    return Settings.from_environment({"ROBOMAKER_HOME": str(tmp_path)})


def test_a_console_is_found_while_it_answers(settings: Settings) -> None:
    assert pages_here(settings) == NO_CONSOLE
    with socket.create_server(("127.0.0.1", 0)) as server:
        url = f"http://127.0.0.1:{server.getsockname()[1]}/console"
        note_console(settings.home, url)
        assert pages_here(settings).run("night-1") == f"{url}/runs/night-1"
        assert pages_elsewhere(settings) == NO_CONSOLE, "nobody else can open it"
    assert pages_here(settings) == NO_CONSOLE
    forget_console(settings.home)
    assert list(settings.home.iterdir()) == []


def test_the_console_of_the_home_that_was_copied_is_not_the_one_of_the_copy(settings: Settings, tmp_path: Path) -> None:
    copy = Settings.from_environment({"ROBOMAKER_HOME": str(tmp_path / "copy")})
    copy.home.mkdir()
    with socket.create_server(("127.0.0.1", 0)) as server:
        note_console(settings.home, f"http://127.0.0.1:{server.getsockname()[1]}/console")
        shutil.copyfile(settings.home / "console.json", copy.home / "console.json")
        assert pages_here(settings) != NO_CONSOLE
        assert pages_here(copy) == NO_CONSOLE


def test_a_note_that_is_none_is_no_console(settings: Settings) -> None:
    for text in (
        "{",
        "[]",
        '{"url": 7}',
        '{"url": "nowhere"}',
        '{"url": "http://[::1"}',
        '{"url": "http://a:99999999"}',
    ):
        (settings.home / "console.json").write_text(text)
        assert pages_here(settings) == NO_CONSOLE
    forget_console(settings.home)
    assert (settings.home / "console.json").exists(), "it is not ours"


@pytest.mark.parametrize("host", ["127.0.0.1", "127.8.0.1", "[::1]", "localhost", "robots.localhost"])
def test_addresses_of_this_machine_alone_are_not_for_others(
    settings: Settings, host: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(socket, "create_connection", lambda *_: socket.socket())
    (settings.home / "console.json").write_text(json.dumps({"url": f"http://{host}:4880/console"}))
    assert pages_here(settings).url == f"http://{host}:4880/console"
    assert pages_elsewhere(settings) == NO_CONSOLE
    (settings.home / "console.json").write_text(json.dumps({"url": "http://10.0.0.7:4880/console"}))
    assert pages_elsewhere(settings).url == "http://10.0.0.7:4880/console"


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ("https://robots.example/console", "https://robots.example/console"),
        ("https://robots.example/console/", "https://robots.example/console"),
        ("https://robots.example", "https://robots.example/console"),
        ("http://10.0.0.7:4880/", "http://10.0.0.7:4880/console"),
        # Whoever gives it knows that the port is forwarded.
        ("http://127.0.0.1:8080/console", "http://127.0.0.1:8080/console"),
    ],
)
def test_the_address_that_is_given_goes_first(tmp_path: Path, given: str, expected: str) -> None:
    settings = Settings.from_environment({"ROBOMAKER_HOME": str(tmp_path), "ROBOMAKER_CONSOLE_URL": given})
    assert pages_here(settings).url == pages_elsewhere(settings).url == expected


@pytest.mark.parametrize(
    "given",
    [
        "http://u:p@robots.example/console",
        "robots.example",
        "ftp://robots.example",
        "https://",
        "https://a/b?c=d",
        "https://a b",
    ],
)
def test_an_address_that_is_none_is_refused(tmp_path: Path, given: str) -> None:
    with pytest.raises(ConfigurationError, match="ROBOMAKER_CONSOLE_URL"):
        Settings.from_environment({"ROBOMAKER_HOME": str(tmp_path), "ROBOMAKER_CONSOLE_URL": given})


def test_pages_have_addresses_of_ids() -> None:
    pages = ConsolePages("https://robots.example/console")
    arn = "arn:aws:robomaker:us-east-1:000000000000:simulation-job/sim-1"
    assert pages.job(arn) == "https://robots.example/console/jobs/sim-1"
    assert pages.job(None) == NO_CONSOLE.job(arn) == NO_CONSOLE.run("night-1") == ""
