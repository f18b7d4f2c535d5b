"""When a browser is opened."""

from prefect_robomaker.deployments.cli.output.answers import opens_files


def test_a_browser_opens_only_for_somebody_at_a_desktop(monkeypatch) -> None:
    monkeypatch.setattr("sys.stdout.isatty", lambda: True, raising=False)
    monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
    assert opens_files(None, {"DISPLAY": ":0"})
    assert not opens_files(None, {})
    assert not opens_files(None, {"DISPLAY": ":0", "SSH_CONNECTION": "x"})
    assert not opens_files(None, {"DISPLAY": ":0", "CI": "true"})
    assert opens_files(True, {})
    assert not opens_files(False, {"DISPLAY": ":0"})
