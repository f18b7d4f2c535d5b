"""What `robomaker fsck` says: problem by problem, then what it comes to."""

from collections import Counter

from rich.filesize import decimal

from ....schemas.reports.consistency import LOSSES, ConsistencyReport, Finding


def report_lines(report: ConsistencyReport) -> list[str]:
    """The answer, line by line."""
    lines = [line for finding in report.findings for line in _lines(finding)]
    objects = f"{report.objects} {'object' if report.objects == 1 else 'objects'} of {report.resources}"
    resources = "resource" if report.resources == 1 else "resources"
    how = "content compared" if report.read_content else "sizes compared, content with --read-content"
    lines.append(f"Checked {objects} {resources}, {decimal(report.size_bytes)}; {how}.")
    lines.append(_conclusion(report))
    return lines


def _lines(finding: Finding) -> list[str]:
    mark = "mended" if finding.mended else finding.problem.value
    lines = [f"{mark}: {finding.where}"]
    if finding.resource is not None:
        lines.append(f"  of {finding.resource.split(':', 5)[-1]}")
    if finding.detail:
        lines.append(f"  {finding.detail}")
    if finding.remedy and not finding.mended:
        lines.append(f"  {finding.remedy}")
    return lines


def _conclusion(report: ConsistencyReport) -> str:
    left = report.open_findings
    mended = sum(finding.mended for finding in report.findings)
    done = f"Mended {mended}. " if mended else ""
    if not left:
        return f"{done}Catalog and object store agree."
    counts = Counter(finding.problem.value for finding in left)
    lost = sum(finding.problem in LOSSES for finding in left)
    words = ", ".join(f"{count} {problem}" for problem, count in counts.items())
    told = f"; {lost} of them only a backup or another run brings back" if lost else ""
    return f"{done}{len(left)} {'problem is' if len(left) == 1 else 'problems are'} left: {words}{told}."
