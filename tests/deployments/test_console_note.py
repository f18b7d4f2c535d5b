"""Links to a console are printed only while it answers."""

import socket
from pathlib import Path

from prefect_robomaker.deployments.console_note import console_of, forget_console, note_console


def test_a_console_is_found_while_it_answers(tmp_path: Path) -> None:
    assert console_of(tmp_path) == ""
    with socket.create_server(("127.0.0.1", 0)) as server:
        url = f"http://127.0.0.1:{server.getsockname()[1]}"
        note_console(tmp_path, url)
        assert console_of(tmp_path) == f"{url}/console"
    assert console_of(tmp_path) == ""
    forget_console(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_note_that_is_none_is_no_console(tmp_path: Path) -> None:
    for text in ("{", "[]", '{"url": 7}', '{"url": "nowhere"}'):
        (tmp_path / "console.json").write_text(text)
        assert console_of(tmp_path) == ""
    forget_console(tmp_path)
    assert (tmp_path / "console.json").exists(), "it is not ours"
