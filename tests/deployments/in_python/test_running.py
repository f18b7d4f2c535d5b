"""Running a specification in Python."""

import asyncio
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from prefect_robomaker import ConfigurationError, RunOptions, SpecError, run
from prefect_robomaker.deployments.in_python.options import checked_options
from prefect_robomaker.schemas.backends import BACKENDS_IN_WORDS
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
        with pytest.raises(
            SpecError, match=r"there is no parameter 'seed'; .*; seed is an option of runs: RunOptions\(seed=3\)"
        ):
            run(spec, seed=3)
        with pytest.raises(ConfigurationError, match="no such file"):
            run(spec.with_name("other.yaml"))
        with pytest.raises(ConfigurationError, match=r"report is .*/none/r.html; it has to be a file in a folder"):
            run(spec, RunOptions(report=spec.parent / "none" / "r.html"))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"seed": -1}, "seed is -1; it has to be a whole number from 0 to 9223372036854775807"),
        ({"seed": 2**63}, "seed is 9223372036854775808; it has to be a whole number from 0 to"),
        ({"seed": 1.5}, "seed is 1.5; a whole number from 0, such as 7, would be right"),
        ({"seed": "7"}, "seed is '7'; a whole number from 0, such as 7, would be right"),
        ({"seed": True}, "seed is True; a whole number from 0, such as 7, would be right"),
        ({"name": 3}, "name is 3; letters, digits, - and _ would be right"),
        ({"name": "a b"}, "name is 'a b'; letters, digits, - and _ would be right"),
        ({"backend": "dusk"}, f"backend is 'dusk'; it has to be {BACKENDS_IN_WORDS}"),
        ({"backend": "dask:head"}, "backend is 'dask:head'; after dask: there has to be the address"),
        ({"backend": 3}, "backend is 3; a text such as 'local' would be right"),
        ({"reuse": "no"}, "reuse is 'no'; True or False would be right"),
        ({"shows_progress": None}, "shows_progress is None; True or False would be right"),
        ({"report": 3}, "report is 3; the path of a file would be right"),
        ({"report": "a\0b"}, "report is 'a\\x00b'; the path of a file would be right"),
    ],
)  # fmt: skip
def test_an_option_with_a_wrong_value_is_refused_when_it_is_given(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        RunOptions(**options)
    assert str(caught.value).startswith(message)


@pytest.mark.parametrize("options", [{"seed": 1}, {}])
def test_options_of_another_type_are_refused_and_nothing_is_started(
    options: Any, spec: Path, service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("prefect_robomaker.deployments.in_python.running.server_of_process", pytest.fail)
    with service.activated(), pytest.raises(ConfigurationError) as caught:
        run(spec, options)
    assert str(caught.value) == f"options is {options}; RunOptions(seed=7), with the options by name, would be right"
    assert not (service.settings.home / "runs").exists()


@pytest.mark.parametrize("given", [None, 3, b"spec.yaml", "spec\0.yaml"])
def test_a_specification_that_is_no_path_is_refused_in_a_sentence(given: Any, service: Service) -> None:
    right = "the path of a specification, 'quickstart' or 'nightly' would be right"
    with service.activated(), pytest.raises(ConfigurationError) as caught:
        run(given)
    assert str(caught.value) == f"spec is {given!r}; {right}"


@pytest.mark.parametrize("seed", [0, 2**63 - 1, np.int64(11)])
def test_any_whole_number_in_range_is_a_seed(seed: Any) -> None:
    found = checked_options(RunOptions(seed=seed)).seed
    assert (found, type(found)) == (seed, int)
