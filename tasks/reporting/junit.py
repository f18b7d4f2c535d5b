"""Reports as JUnit XML, for whatever shows the results of tests.

A step of the pipeline is a test suite, a job a test case: FAIL is a failure, ERROR an error, a job that was
cancelled or that nobody judged is skipped. Only what strict readers allow is written: no `properties` in test
cases, for one. A job's id, seed, world and outputs are properties of its suite (`<test case>.seed`), and its
`system-out`. Test cases have no ids in their names: what collects results from run to run knows tests by their names.
"""

import re
from collections.abc import Iterator
from xml.etree import ElementTree

from ...schemas.reports.summary import JobCase, ReportSummary, StepSuite

# What XML 1.0 has no place for.
_IMPOSSIBLE = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_MAX_MESSAGE = 200
_SKIPPED = ("canceled", "unfinished", "no verdict")


def junit_xml(summary: ReportSummary) -> bytes:
    """Writes a report as JUnit XML, in UTF-8."""
    suites = [_suite(step, summary) for step in summary.steps]
    root = ElementTree.Element("testsuites", {"name": _clean(summary.name), "time": _seconds(summary.time_s)})
    for name in ("tests", "failures", "errors"):
        root.set(name, str(sum(int(suite.get(name, "0")) for suite in suites)))
    root.extend(suites)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="utf-8", xml_declaration=True) + b"\n"


def _suite(step: StepSuite, summary: ReportSummary) -> ElementTree.Element:
    outcomes = [job.outcome for job in step.jobs]
    counts = {
        "tests": len(step.jobs) + bool(step.error),
        "failures": outcomes.count("failed"),
        "errors": outcomes.count("broken") + bool(step.error),
        "skipped": sum(outcome in _SKIPPED for outcome in outcomes),
    }
    suite = ElementTree.Element(
        "testsuite",
        {
            "name": _clean(f"{summary.name}.{step.name}"),
            **{name: str(count) for name, count in counts.items()},
            "time": _seconds(step.time_s),
            "timestamp": f"{summary.started_at:%Y-%m-%dT%H:%M:%S}",
        },
    )
    properties = ElementTree.SubElement(suite, "properties")
    for name, value in _properties(step, summary):
        ElementTree.SubElement(properties, "property", {"name": _clean(name), "value": _clean(value)})
    if step.error:
        suite.append(_failed_step(step, summary))
    suite.extend(_case(job, f"{summary.name}.{step.name}") for job in step.jobs)
    return suite


def _properties(step: StepSuite, summary: ReportSummary) -> Iterator[tuple[str, str]]:
    yield from (("run", summary.run_id), ("operation", step.operation))
    for job in step.jobs:
        for name, value in _facts(job):
            yield f"{job.test}.{name}", value


def _facts(job: JobCase) -> Iterator[tuple[str, str]]:
    facts = {"job": job.name, "seed": job.seed, "world": job.world, "output": job.output, "arn": job.arn}
    yield from ((name, str(value)) for name, value in facts.items() if value is not None)


def _failed_step(step: StepSuite, summary: ReportSummary) -> ElementTree.Element:
    case = _element("testcase", name=step.operation, classname=f"{summary.name}.{step.name}", time=_seconds(0.0))
    case.append(_told("error", step.status, step.error))
    return case


def _case(job: JobCase, owner: str) -> ElementTree.Element:
    case = _element("testcase", name=job.test, classname=owner, time=_seconds(job.time_s))
    if job.outcome == "failed":
        case.append(_told("failure", "FAIL", job.reason))
    elif job.outcome == "broken":
        case.append(_told("error", job.failure_code or "ERROR", job.reason))
    elif job.outcome in _SKIPPED:
        case.append(_element("skipped", message=job.outcome))
    output = ElementTree.SubElement(case, "system-out")
    output.text = _clean("\n".join(_lines(job)))
    return case


def _lines(job: JobCase) -> Iterator[str]:
    """What a person wants to know of a job, one thing a line."""
    yield from (f"{name}: {value}" for name, value in _facts(job))
    for item in job.requirements:
        word = "ERROR" if item.error is not None else "PASS" if item.satisfied else "FAIL"
        yield f"{word if item.counts else 'does not count'}: {item.name}: {item.detail}"
    yield from job.remarks
    yield from (f"{name}: {value:g}" for name, value in sorted(job.metrics.items()))


def _told(tag: str, kind: str, reason: str) -> ElementTree.Element:
    """An element whose message is the first line of a reason, and whose text is all of it."""
    first = (reason.splitlines() or [""])[0]
    element = _element(tag, type=kind, message=first if len(first) <= _MAX_MESSAGE else f"{first[: _MAX_MESSAGE - 1]}…")
    element.text = _clean(reason)
    return element


def _element(tag: str, **attributes: str) -> ElementTree.Element:
    return ElementTree.Element(tag, {name: _clean(value) for name, value in attributes.items()})


def _clean(text: str) -> str:
    return _IMPOSSIBLE.sub("\ufffd", text)


def _seconds(value: float) -> str:
    return f"{max(value, 0.0):.3f}"
