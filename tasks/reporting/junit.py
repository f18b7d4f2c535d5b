"""Reports as JUnit XML, for CI servers and other viewers of test results.

A step of the pipeline is a test suite, a job a test case: FAIL is a failure, ERROR an error, a job that was
cancelled, has no verdict or fails as is known is skipped; one that the timeout of its batch ended, or kept from
running, is an error.
Where no job and no step says why a run did not succeed, a suite of its own has an error: a file without failures and
errors means that `robomaker run` ended with 0.

Only what strict readers allow is written: no `properties` in test cases, for one. A job's id, seed, world and outputs
are properties of its suite (`<test case>.seed`), and its `system-out`. Test cases have no ids in their names: what
collects results from run to run knows tests by their names.
"""

import re
from collections.abc import Iterator
from xml.etree import ElementTree

from ...schemas.reports.report import JobCase, ReportSummary, StepSuite
from .console_pages import ConsolePages

# What XML 1.0 has no place for.
_IMPOSSIBLE = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_MAX_MESSAGE = 200
_KNOWN = "known"
_SKIPPED = ("canceled", "unfinished", "no verdict", _KNOWN)
_TIMED_OUT = "BatchTimedOut"
_BAD = ("failures", "errors")


def junit_xml(summary: ReportSummary) -> bytes:
    """Converts a run's report to JUnit XML (UTF-8), for CI systems."""
    suites = [_suite(step, summary) for step in summary.steps]
    if summary.state != "succeeded" and not any(int(suite.get(bad, "0")) for suite in suites for bad in _BAD):
        suites.append(_end_of_run(summary))
    counts = {name: sum(int(suite.get(name, "0")) for suite in suites) for name in ("tests", *_BAD)}
    root = _element("testsuites", *suites, name=summary.name, time=_seconds(summary.time_s), **counts)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="utf-8", xml_declaration=True) + b"\n"


def _end_of_run(summary: ReportSummary) -> ElementTree.Element:
    """Makes a JUnit test suite with one error, for a run that failed for a reason that no job or step has."""
    name = f"{summary.name}.run"
    error = _told("error", summary.state, f"the run was not carried out as ordered: {summary.state}")
    case = _element("testcase", error, name="end of the run", classname=name, time=_seconds(0.0))
    properties = _element("properties", _element("property", name="run", value=summary.run_id))
    return _element(
        "testsuite",
        properties,
        case,
        name=name,
        tests=1,
        failures=0,
        errors=1,
        skipped=0,
        time=_seconds(0.0),
        timestamp=f"{summary.started_at:%Y-%m-%dT%H:%M:%S}",
    )


def _suite(step: StepSuite, summary: ReportSummary) -> ElementTree.Element:
    name = f"{summary.name}.{step.name}"
    pages = ConsolePages(summary.console_url)
    cases = [_case(job, name, pages) for job in step.jobs]
    if step.error:
        failed = _told("error", step.status, step.error)
        cases.insert(0, _element("testcase", failed, name=step.operation, classname=name, time=_seconds(0.0)))
    properties = [_element("property", name=key, value=value) for key, value in _properties(step, summary)]
    outcomes = ["broken" if _is_error(job) else _KNOWN if job.known else job.outcome for job in step.jobs]
    return _element(
        "testsuite",
        _element("properties", *properties),
        *cases,
        name=name,
        tests=len(cases),
        failures=outcomes.count("failed"),
        errors=outcomes.count("broken") + bool(step.error),
        skipped=sum(outcome in _SKIPPED for outcome in outcomes),
        time=_seconds(step.time_s),
        timestamp=f"{summary.started_at:%Y-%m-%dT%H:%M:%S}",
    )


def _properties(step: StepSuite, summary: ReportSummary) -> Iterator[tuple[str, str]]:
    yield from (("run", summary.run_id), ("operation", step.operation))
    pages = ConsolePages(summary.console_url)
    if page := pages.run(summary.run_id):
        yield "page", page


def _facts(job: JobCase, pages: ConsolePages) -> Iterator[tuple[str, str]]:
    facts = {
        "name": job.title or None,
        "test": job.test,
        "job": job.name,
        "seed": job.seed,
        "world": job.world,
        "output": job.output,
        "arn": job.arn,
    }
    facts |= {"page": pages.job(job.arn) or None}
    facts |= {"results taken over from": job.reused_from, "before": job.earlier}
    yield from ((name, str(value)) for name, value in facts.items() if value is not None)


def _case(job: JobCase, suite: str, pages: ConsolePages) -> ElementTree.Element:
    case = _element("testcase", name=job.case_name, classname=suite, time=_seconds(job.time_s))
    if job.known:
        case.append(_element("skipped", message=_clean(f"known, {job.known}")))
    elif job.outcome == "failed":
        case.append(_told("failure", "FAIL", job.reason))
    elif _is_error(job):
        why = job.reason or ("the timeout of its batch was over" if job.failure_code == _TIMED_OUT else "")
        case.append(_told("error", job.failure_code or "ERROR", why))
    elif job.outcome in _SKIPPED:
        case.append(_element("skipped", message=job.outcome))
    output = _element("system-out")
    output.text = _clean("\n".join(_lines(job, pages)))
    case.append(output)
    return case


def _is_error(job: JobCase) -> bool:
    return job.outcome == "broken" or (job.outcome in _SKIPPED and job.failure_code == _TIMED_OUT)


def _lines(job: JobCase, pages: ConsolePages) -> Iterator[str]:
    """Yields the facts about a job for people, one per line: its facts, requirements, remarks and metrics."""
    yield from (f"{name}: {value}" for name, value in _facts(job, pages))
    of_trials = any(item.name == "trials" for item in job.requirements)
    for item in job.requirements:
        word = "ERROR" if item.error is not None else "PASS" if item.satisfied else "FAIL"
        yield f"{'does not count' if item.is_aside(of_trials=of_trials) else word}: {item.name}: {item.detail}"
    yield from job.remarks
    yield from (f"{name}: {value:g}" for name, value in sorted(job.metrics.items()))


def _told(tag: str, kind: str, reason: str) -> ElementTree.Element:
    """Makes a JUnit element whose message is the cut first line of a reason, and whose text is the whole reason."""
    first = (reason.splitlines() or [""])[0]
    message = first if len(first) <= _MAX_MESSAGE else f"{first[: _MAX_MESSAGE - 1]}…"
    element = _element(tag, type=kind, message=message)
    element.text = _clean(reason)
    return element


def _element(tag: str, *inner: ElementTree.Element, **attributes: str | int) -> ElementTree.Element:
    element = ElementTree.Element(tag, {name: _clean(str(value)) for name, value in attributes.items()})
    element.extend(inner)
    return element


def _clean(text: str) -> str:
    return _IMPOSSIBLE.sub("\ufffd", text)


def _seconds(value: float) -> str:
    return f"{max(value, 0.0):.3f}"
