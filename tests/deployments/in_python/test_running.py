"""Running a specification in Python."""

import asyncio
from pathlib import Path

import pytest

from prefect_robomaker import ConfigurationError, RunOptions, SpecError, run
from prefect_robomaker.tasks.service.service import Service

SPEC = """\
version: 1
name: templates
parameters:
  options: {default: flat}
  name: {default: none}
steps:
  flat:
    operation: CreateWorldTemplate
    input: {name: "${{ parameters.options }}", templateBody: {Buildings: [{Floors: [{Floorplan: {}}]}]}}
  other:
    operation: CreateWorldTemplate
    input: {name: other, templateLocation: {s3Bucket: no-such-bucket, s3Key: "${{ flat.name }}.json"}}
"""


@pytest.fixture
def spec(tmp_path: Path) -> Path:
    path = tmp_path / "templates.yaml"
    path.write_text(SPEC)
    return path


def test_a_run_that_breaks_raises_nothing_says_why_and_is_not_taken_for_good(
    spec: Path, service: Service, prefect_server: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its parameters may have the names of arguments, and it runs in an event loop."""

    async def cell() -> None:
        ended = run(spec, RunOptions(name="mine", shows_progress=False, report=spec.with_name("r.html")), options="hut")

        assert (ended.outcome, ended.passed, ended.exit_code, ended.rows) == ("broken", False, 3, [])
        assert "no-such-bucket" in ended.problems["other"]
        assert ended.problems["other"] in ended._repr_html_().replace("&#39;", "'")
        assert (ended.name, ended.parameters) == ("mine", {"options": "hut", "name": "none"})
        assert spec.with_name("r.html").read_bytes() == (ended.report or spec).read_bytes()

    with service.activated():
        asyncio.run(cell())
    assert capsys.readouterr().err == ""


def test_wrong_calls_are_refused_before_anything_is_started(
    spec: Path, service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("prefect_robomaker.deployments.in_python.running.server_of_process", pytest.fail)
    with service.activated():
        with pytest.raises(SpecError, match="there is no parameter 'nam'; did you mean 'name'"):
            run(spec, nam="x")
        with pytest.raises(ConfigurationError, match="no such file"):
            run(spec.with_name("other.yaml"))
        with pytest.raises(ConfigurationError, match="'dusk'; it has to be local"):
            run(spec, RunOptions(backend="dusk"))
        with pytest.raises(ConfigurationError, match="seed is -1"):
            run(spec, RunOptions(seed=-1))
        with pytest.raises(ConfigurationError, match=r"report is .*/none/r.html; it has to be a file in a folder"):
            run(spec, RunOptions(report=spec.parent / "none" / "r.html"))
