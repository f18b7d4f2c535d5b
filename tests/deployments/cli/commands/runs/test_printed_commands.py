"""Commands that a failed run prints, in its summary, report, Markdown and pages: each runs as it is printed."""

import html
import re
import shlex
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import pytest
from helpers.cartpole_spec import PACKAGE, poles
from helpers.console_visitors import browser, visitor  # noqa: F401 - fixtures

from prefect_robomaker.tasks.service.service import Service

GAIN = 'GAIN: "1"'
GAINS = ("1", "0", "none", "1")
"""Gain of the robot of each job: one with a weak motor in some trials, one that falls, and one that is no number."""
NO_ARCHIVE = "dataSources: [{name: map, type: Archive, destination: /map, s3Bucket: robomaker, s3Keys: [map.zip]}]"
"""Members of a job that breaks before it runs: the object is there, and is no archive."""
FALLS = "trials: {seeds: 2, axes: {gain: {kind: motor_gain, values: [1.0, 0.1]}}}"
"""Members of a job with trials of which those with a weak motor fail."""


@pytest.fixture
def home(service: Service) -> Path:
    """The data home of the service that pages are shown of."""
    return service.settings.home


def printed_in(*texts: str) -> Iterator[str]:
    """Yields the commands of pages and texts: those in code, and those at the end of a line."""
    for text in texts:
        for code in re.findall(r"<code[^>]*>(.*?)</code>", text, re.DOTALL):
            yield html.unescape(re.sub(r"<[^>]*>", "", code))
        yield from re.findall(r"`(robomaker [^`]*)`", text)
        yield from re.findall(r"(?:; |again +|Look: )(robomaker .*)$", text, re.MULTILINE)


def complete(commands: Iterable[str]) -> list[str]:
    """Returns commands without those that are only named, as in `robomaker flaky` or `robomaker run SPEC`."""
    words = {each: shlex.split(each) for each in commands}
    return [
        each
        for each, parts in words.items()
        if parts[0] == "robomaker" and len(parts) > 2 and not any(part.isupper() for part in parts)
    ]


@pytest.mark.deep
@pytest.mark.timeout(900)
def test_each_command_that_a_failed_run_prints_runs_as_it_is_printed(
    robomaker_at_server: Callable[..., Any],
    browser: Any,  # noqa: F811 - a fixture
    service: Service,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The run has a job with trials that fail, one that fails without trials, and two that break."""
    monkeypatch.setenv("PYTHONPATH", str(PACKAGE))
    monkeypatch.syspath_prepend(str(PACKAGE))
    monkeypatch.chdir(tmp_path)
    before, *jobs = re.split(r"^(?=        - max)", poles(FALLS, "seed: 1", "seed: 2", NO_ARCHIVE), flags=re.MULTILINE)
    gained = [job.replace(GAIN, f'GAIN: "{gain}"') for job, gain in zip(jobs, GAINS, strict=True)]
    spec = before + "".join(gained).replace('TIME_LIMIT_S: "0.5"', 'TIME_LIMIT_S: "3"')
    Path("poles.yaml").write_text(spec)
    service.store.ensure_bucket("robomaker")
    service.store.put_bytes("robomaker", "map.zip", b"no archive")
    ended = [robomaker_at_server("run", "poles.yaml") for _ in range(2)][-1]
    assert ended.code == 3, ended.err
    told = robomaker_at_server("report", "--markdown", "run.md")
    report = Path(told.out.strip())
    pages = [f"/console/runs/{report.parent.name}"]
    pages += [f"/console/jobs/{job}" for job in set(re.findall(r"sim-[0-9a-z]{12}", report.read_text()))]
    texts = [browser.get(page).text for page in pages]
    texts += [ended.out, ended.err, told.err, report.read_text(), Path("run.md").read_text()]
    commands = complete(printed_in(*texts))

    assert {shlex.split(each)[1] for each in commands} >= {"run", "rerun", "compare", "repro", "verify"}, commands
    refused = {}
    for number, command in enumerate(sorted(commands)):
        folder = tmp_path / str(number)
        folder.mkdir()
        (folder / "poles.yaml").write_text(spec)
        monkeypatch.chdir(folder)
        done = robomaker_at_server(*shlex.split(command)[1:])
        if done.code == 2:  # a command that cannot be understood
            refused[command] = done.err
    assert refused == {}
