"""When a browser is opened."""

from prefect_robomaker.deployments.cli.output.answers import wanted


def test_a_browser_opens_only_for_somebody_at_a_desktop(monkeypatch) -> None:
    monkeypatch.setattr("sys.stdout.isatty", lambda: True, raising=False)
    monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
    assert wanted(None, {"DISPLAY": ":0"})
    assert not wanted(None, {})
    assert not wanted(None, {"DISPLAY": ":0", "SSH_CONNECTION": "x"})
    assert not wanted(None, {"DISPLAY": ":0", "CI": "true"})
    assert wanted(True, {})
    assert not wanted(False, {"DISPLAY": ":0"})
