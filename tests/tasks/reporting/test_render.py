import io
import os
import re
import sys
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path
from typing import Any

import jinja2
import pytest
from helpers.paths import REPOSITORY
from PIL import Image

from prefect_robomaker.schemas.job_owners import JobOwner
from prefect_robomaker.schemas.reports.forecast import ForecastCheck
from prefect_robomaker.schemas.reports.report import Report, ReportedFile, ReportedStep
from prefect_robomaker.schemas.runs.programs import ToolEnds
from prefect_robomaker.schemas.worlds.world import World
from prefect_robomaker.tasks.reporting import page_environment, render_report, summarize, write_report

ATTACK = "</pre></title><script>alert(1)</script><img src=x onerror=alert(2)>\"'&"
_VOID = {"meta", "link", "img", "br", "hr", "input"}
_STYLE_SHEET = REPOSITORY / "tasks" / "reporting" / "report.css"


class Document(HTMLParser):
    """A page as a list of elements, checking that every element is closed where it should be."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self._open: list[str] = []
        self.feed(html)
        self.close()
        assert not self._open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag not in _VOID:
            self._open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        if not {"style", "script"} & set(self._open):
            self.text += data

    def all(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.elements if name == tag]

    def values(self, attribute: str) -> list[str]:
        return [attributes[attribute] or "" for _, attributes in self.elements if attribute in attributes]


def _attacked(make_world: Any, make_job: Any, make_result: Any, make_report: Any) -> Report:
    """A report with an attack in every text that comes from elsewhere."""
    plain = World.model_validate_json(make_world().world_json.read_bytes())
    renamed = plain.floorplan.rooms[0].model_copy(update={"name": ATTACK})
    chair = plain.furniture[0].model_copy(update={"id": ATTACK, "model_type": ATTACK})
    wish = plain.wishes[0].model_copy(update={"path": ATTACK, "wish": ATTACK, "reason": ATTACK})
    floorplan = plain.floorplan.model_copy(update={"rooms": [renamed, *plain.floorplan.rooms[1:]]})
    hostile = plain.model_copy(update={"floorplan": floorplan, "furniture": [chair], "wishes": [wish]})
    world = make_world(world=hostile).model_copy(update={"arn": ATTACK, "label": ATTACK})
    result = make_result("FAIL", 9, hits=2)
    result = result.model_copy(
        update={
            "summary": ATTACK,
            "ended_by": ATTACK,
            "metrics": {ATTACK: 1.0},
            "rooms": [result.rooms[0].model_copy(update={"name": ATTACK})],
            "requirements": [result.requirements[0].model_copy(update={"name": ATTACK, "detail": ATTACK})],
            "collisions": [result.collisions[0].model_copy(update={"other": ATTACK})],
        }
    )
    file = ReportedFile(name=ATTACK, uri=f"javascript:alert(3)//{ATTACK}", size_bytes=1)
    job = make_job(
        ATTACK, ATTACK, result=result, failure_code=ATTACK, failure_reason=ATTACK, log_tail=f"log {ATTACK}",
        arn=ATTACK, files=[file],
    )  # fmt: skip
    step = ReportedStep(name=ATTACK, operation=ATTACK, status=ATTACK, duration_s=1.0, detail=ATTACK)
    return make_report(
        [world], [job], name=ATTACK, run_id=ATTACK, command=ATTACK, where=ATTACK, steps=[step],
        versions={ATTACK: ATTACK},
    )  # fmt: skip


def test_failures_come_before_everything_else(mixed_report: Report) -> None:
    html = render_report(mixed_report)
    order = [
        html.index(f">{text}</h3>")
        for text in ("sim-fail1", "sim-broken1", "sim-cancel1", "sim-pass1", "generation-1/world-1")
    ]
    assert order == sorted(order)
    assert html.index('id="failures"') < html.index('id="table"') < html.index('id="jobs"') < html.index('id="worlds"')


def test_says_what_a_reader_wants_to_know(mixed_report: Report) -> None:
    text = Document(render_report(mixed_report)).text
    for expected in (
        "2 of 5 jobs passed; 1 broken, 1 failed, 1 canceled",
        "2 of 3 judged jobs passed; 95\xa0% interval 21 to 94\xa0% (Wilson)",
        "1 broke and is not judged; counted as a failure, the rate would be 50\xa0% (15 to 85\xa0%).",
        "2026-03-02 09:30:00 UTC",
        "1 min 23 s",
        "build-7, outputs in file:///data/out",
        "robomaker run nightly-flats.yaml",
        "RobotApplicationCrash",
        "return goal / distance\nlast log line",
        "4.2 MB, open in Foxglove",
        "Visited 4 of 7 rooms in 35 s.",
        "no free wall is left",
        "CreateWorldGenerationJob",
        "3.17.0",
    ):
        assert expected in text
    assert "\x1b" not in text


def test_a_run_that_was_forecast_says_how_far_off_that_was(mixed_report: Report) -> None:
    assert "Forecast" not in Document(render_report(mixed_report)).text
    check = ForecastCheck(made_at=mixed_report.started_at, forecast_s=60.0, took_s=83.0)
    report = mixed_report.model_copy(update={"forecast": check})
    assert "1 min; it took 38\xa0% more" in Document(render_report(report)).text.replace(" %", "\xa0%")
    assert summarize(report).forecast == check


def test_waits_for_the_machine_are_told_for_the_run_and_for_each_job(
    make_report: Any, make_job: Any, make_result: Any
) -> None:
    jobs = [
        make_job(f"sim-{number}", None, result=make_result("PASS", 9), waited_s=waited_s)
        for number, waited_s in enumerate(({"memory": 60.0, "slots": 2.0}, {"memory": 5.0}, {}))
    ]
    page = Document(render_report(make_report([], jobs)))

    assert "2 of 3 jobs: 2.0 s for a slot, 1 min 5 s for memory in all" in page.text
    assert page.text.count("waited for memory") == 2
    assert "Waited for the machine" not in Document(render_report(make_report([], jobs[2:]))).text


def test_a_job_says_how_long_its_videos_and_its_upload_took_after_its_run(
    make_report: Any, make_job: Any, make_result: Any
) -> None:
    """Its wall time is that of the run."""
    times = {"duration_s": 18.0, "video_s": 252.0, "upload_s": 0.2}
    page = Document(render_report(make_report([], [make_job("sim-1", None, result=make_result("PASS", 9), **times)])))

    assert re.search(r"wall time\s*18.0\s*s", page.text)
    assert re.search(r"videos after the run\s*252.0\s*s", page.text)
    assert not re.search(r"upload\s*0.2", page.text)
    assert "Videos of failures are drawn and outputs stored after it" in page.text


def test_who_carried_out_the_jobs_is_told_by_machine(make_report: Any, make_job: Any) -> None:
    owners = [JobOwner(program="a job worker", machine=name, process_id=place) for place, name in enumerate("aba")]
    jobs = [make_job(f"sim-{owner.process_id}", None, carried_out_by=owner) for owner in owners]
    taken_over = make_job("sim-9", None, carried_out_by=owners[0], reused_from="run-1")
    text = Document(render_report(make_report([], [*jobs, taken_over]))).text
    assert "Carried out bya job worker on a: 2 jobs, a job worker on b: 1 job" in " ".join(text.split())  # two cells


def test_the_table_has_every_job_with_sortable_numbers(mixed_report: Report) -> None:
    html = render_report(mixed_report)
    table = html[html.index('<table class="sortable stacks"') :]
    rows = re.findall(r"<tr>(.*?)</tr>", table[: table.index("</table>")], re.DOTALL)
    assert len(rows) == 1 + len(mixed_report.jobs)
    cells = [re.sub(r"<[^>]+>", "", cell).strip() for cell in re.findall(r"<t[hd].*?</t[hd]>", rows[2], re.DOTALL)]
    assert cells[0] == "2 sim-fail1generation-1/world-1"
    assert cells[1].startswith("failedrooms visited")
    assert cells[2:] == ["4/7", "17.7", "35.4", "21.0", "5", "167", "7.4"]
    assert all(len(re.findall("<t[hd]", row)) == 9 for row in rows)
    assert 'data-sort="167.0"' in rows[2]


def test_the_page_is_well_formed_and_its_references_lead_somewhere(mixed_report: Report) -> None:
    html = render_report(mixed_report)
    page = Document(html)
    ids = page.values("id")
    assert len(ids) == len(set(ids))
    targets = [href[1:] for href in page.values("href") if href.startswith("#")]
    targets += [name for value in page.values("aria-labelledby") for name in value.split()]
    targets += re.findall(r"url\(#([^)]+)\)", html)
    assert set(targets) <= set(ids)
    assert all(image["alt"] for image in page.all("img"))
    levels = [int(tag[1]) for tag, _ in page.elements if re.fullmatch("h[1-6]", tag)]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(after <= before + 1 for before, after in pairwise(levels))


def test_the_page_loads_nothing(mixed_report: Report) -> None:
    html = render_report(mixed_report)
    page = Document(html)
    assert not re.search(r"https?://", html)
    assert all(value.startswith("data:") for value in page.values("src"))
    assert [link["href"] for link in page.all("link")] == ["data:,"]
    assert all(tag["href"].startswith(("#", "file:///")) for tag in page.all("a") if tag["href"])
    policy = page.all("meta")[1]["content"] or ""
    assert policy.startswith("default-src 'none'; img-src data:; style-src 'sha256-")
    assert "unsafe" not in policy
    # The policy forbids these, so they would not work.
    assert not page.values("style")


def test_no_text_becomes_code(make_world: Any, make_job: Any, make_result: Any, make_report: Any) -> None:
    html = render_report(_attacked(make_world, make_job, make_result, make_report))
    page = Document(html)
    assert len(page.all("script")) == 1
    assert not [name for _, attributes in page.elements for name in attributes if name.startswith("on")]
    assert not [href for href in page.values("href") if "javascript" in href]
    assert "<script>alert" not in html
    assert page.text.count("<script>alert(1)</script>") > 20


def test_the_same_report_gives_the_same_page(mixed_report: Report) -> None:
    assert render_report(mixed_report) == render_report(mixed_report)


@pytest.mark.deep
def test_fifty_worlds_stay_below_ten_megabytes(
    make_world: Any, make_job: Any, make_result: Any, make_report: Any
) -> None:
    buffer = io.BytesIO()
    # Noise is the worst case for a picture's size.
    Image.frombytes("RGB", (640, 480), os.urandom(3 * 640 * 480)).save(buffer, "PNG")
    worlds = [make_world(n, preview=False).model_copy(update={"preview_png": buffer.getvalue()}) for n in range(50)]
    result = make_result("PASS", 22, hits=10)
    path = [result.path[index % len(result.path)] for index in range(600)]
    jobs = [make_job(f"sim-{n}", worlds[n].arn, result=result.model_copy(update={"path": path})) for n in range(50)]
    assert len(render_report(make_report(worlds, jobs)).encode()) < 10_000_000


def test_a_run_without_jobs_and_worlds_is_a_page(make_report: Any) -> None:
    page = Document(render_report(make_report([], [], state="succeeded", steps=[], versions={}, where="")))
    assert "Nothing was simulated" in page.text
    assert "This run started no simulation jobs." in page.text
    assert not page.all("table")


def test_jobs_without_result_or_world_say_so(make_report: Any, make_job: Any, make_result: Any) -> None:
    jobs = [
        make_job("sim-1", "arn:gone", result=make_result("PASS", 5)),
        make_job("sim-2", None, result=make_result("NONE", 5)),
        make_job("request 3", None, arn=None, status="NotCreated", files=[], duration_s=None),
    ]
    page = Document(render_report(make_report([], jobs)))
    assert "The world arn:gone is not part of this report." in page.text
    assert "This job drove in no generated world." in page.text
    assert "The job left no result.json, so there is nothing to draw." in page.text
    assert len([svg for svg in page.all("svg") if "plan" in (svg.get("class") or "").split()]) == 2


@pytest.mark.parametrize(("status", "why"), [("Failed", "The job broke before"), ("Canceled", "The job ended before")])
def test_a_job_without_result_names_its_recording(make_report: Any, make_job: Any, status: str, why: str) -> None:
    recording = ReportedFile(name="recording.mcap", uri="file:///out/recording.mcap", size_bytes=9)
    job = make_job("sim-1", None, status=status, result=None, files=[recording])
    page = Document(render_report(make_report([], [job])))
    assert f"{why} it wrote result.json, so no path is drawn; recording.mcap has what it drove." in page.text
    assert "nothing to draw" not in page.text


def test_programs_without_a_simulation_have_no_numbers_of_one(
    make_report: Any, make_job: Any, make_result: Any
) -> None:
    nought = {"sim_time_s": 0.0, "real_time_factor": 0.0, "metrics": {}, "collisions": [], "rooms": []}
    result = make_result("NONE", 5).model_copy(update=nought)
    page = Document(render_report(make_report([], [make_job("sim-1", None, result=result)])))
    assert "real-time factor" not in page.text
    assert "wall time" in page.text
    cells = [cell["data-sort"] for cell in page.all("td") if "data-sort" in cell]
    assert cells[1:] == ["7.4"], "columns without any number are left out"


def test_an_environment_that_counts_no_collisions_has_none_to_show(
    make_report: Any, make_job: Any, make_result: Any
) -> None:
    measured = {"metrics": {"max_contact_force_N": 227.8}, "collisions": []}
    result = make_result("FAIL", 5).model_copy(update=measured)
    page = Document(render_report(make_report([], [make_job("sim-1", None, result=result)])))
    cells = {cell.get("data-label"): cell["data-sort"] for cell in page.all("td") if "data-sort" in cell}
    assert cells["Largest force"] == "227.8"
    assert "Collisions" not in cells


def test_tools_that_kept_dying_are_told(make_report: Any, make_job: Any, make_result: Any) -> None:
    tool = ToolEnds(role="robot", name="rviz<b>", ends=14, last_end="exited with code 1")
    result = make_result("PASS", 5).model_copy(update={"tools": [tool]})
    page = Document(render_report(make_report([], [make_job("sim-1", None, result=result)])))
    assert "rviz<b> of the robot application ended 14 times, and last exited with code 1" in page.text
    [suite] = summarize(make_report([], [make_job("sim-1", None, result=result, step="drive")])).steps
    assert suite.jobs[0].tools == [tool]


def test_what_a_job_went_on_without_is_told(make_report: Any, make_job: Any, make_result: Any) -> None:
    extra = {"camera_error": "there is no camera 'frnt'", "video_error": "no <driver>", "seen": 7}
    result = make_result("PASS", 5).model_copy(update={"extra": extra})
    page = Document(render_report(make_report([], [make_job("sim-1", None, result=result)])))
    assert "no camera in the recording: there is no camera 'frnt'" in page.text
    assert "no video: no <driver>" in page.text
    [suite] = summarize(make_report([], [make_job("sim-1", None, result=result, step="drive")])).steps
    assert suite.jobs[0].remarks == result.remarks
    assert len(result.remarks) == 2


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (None, "cannot be read (No such file or directory)"),
        ("{}", "is not a world: generator_version: Field required"),
        ("no json", "is not a world: the document: Invalid JSON"),
        ("infinite", "cannot be drawn: some coordinates are not finite"),
    ],
)
def test_a_world_that_cannot_be_read_shows_its_own_plan(
    make_world: Any, make_report: Any, make_job: Any, content: str | None, reason: str
) -> None:
    world = make_world(preview=False)
    if content is None:
        world.world_json.unlink()
    else:
        infinite = world.world_json.read_text().replace("[5.5,3.0]", "[Infinity,3.0]")
        world.world_json.write_text(infinite if content == "infinite" else content)
    page = Document(render_report(make_report([world], [make_job("sim-1", world.arn)])))
    assert reason in page.text
    assert "There is no preview." in page.text
    assert [image["class"] for image in page.all("img")] == ["given-plan"]


def test_a_hostile_plan_and_broken_pictures_are_named_not_shown(
    make_world: Any, make_report: Any, make_job: Any
) -> None:
    world = make_world().model_copy(
        update={"floorplan_svg": "<svg><script/></svg>", "preview_png": b"GIF89a", "world_json": Path("/nowhere")}
    )
    page = Document(render_report(make_report([world], [make_job("sim-1", world.arn, poster_png=b"?")])))
    assert "Its floorplan.svg is not shown: the drawing contains <script>." in page.text
    assert "No preview: the picture cannot be read" in page.text
    assert "Frame of the video: the picture cannot be read" in page.text
    assert not page.all("img")


def test_files_without_a_browser_address_are_named_with_their_folder(make_report: Any, make_job: Any) -> None:
    file = ReportedFile(name="logs/stdout.log", uri="s3://runs/out/sim-1/logs/stdout.log", size_bytes=812)
    page = Document(render_report(make_report([], [make_job("sim-1", None, files=[file])])))
    assert "s3://runs/out/sim-1/" in page.text
    assert "812 B" in page.text
    assert not [href for href in page.values("href") if href.startswith("s3:")]


def test_a_file_appears_only_when_it_is_whole(mixed_report: Report, tmp_path: Path) -> None:
    path = tmp_path / "new" / "report.html"
    assert write_report(mixed_report, path) == path
    before = path.read_text(encoding="utf-8")
    assert before == render_report(mixed_report)
    broken = mixed_report.model_copy(update={"jobs": None})
    with pytest.raises(TypeError):
        write_report(broken, path)
    assert path.read_text(encoding="utf-8") == before
    assert [file.name for file in path.parent.iterdir()] == ["report.html"]


def test_bytes_that_are_no_text_do_not_stop_the_report(make_report: Any, make_job: Any, tmp_path: Path) -> None:
    job = make_job("sim-1", None, status="Failed", failure_reason="bad byte \udcff here")
    path = write_report(make_report([], [job]), tmp_path / "report.html")
    assert "bad byte ? here" in path.read_text(encoding="utf-8")


def _luminance(colour: str) -> float:
    channels = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_colours_have_enough_contrast(theme: str) -> None:
    light, dark = _STYLE_SHEET.read_text(encoding="utf-8").split("@media screen and (prefers-color-scheme: dark)")
    colours = dict(re.findall(r"--([\w-]+): (#[0-9a-f]{6})\b", (light if theme == "light" else dark).split("*,")[0]))
    states = ("passed", "failed", "broken", "canceled", "unfinished", "unjudged")
    letters = [(ink, ground) for ink in ("text", "muted", "link") for ground in ("page", "card", "sunken")]
    letters += [(state, f"{state}-soft") for state in states] + [("text", f"{state}-soft") for state in states]
    letters += [("muted", "ground"), ("muted", "floor-visited"), ("text", "hatch-line")]
    shapes = [(f"shade-{i}", floor) for i in range(8) for floor in ("floor", "casing")] + [("hit", "floor-visited")]
    for pairs, wanted in ((letters, 4.5), (shapes, 3.0)):
        for ink, ground in pairs:
            high, low = sorted((_luminance(colours[ink]), _luminance(colours[ground])), reverse=True)
            assert (high + 0.05) / (low + 0.05) >= wanted, f"{theme}: {ink} on {ground}"


def test_templates_are_compiled_once_and_again_where_nothing_may_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    compiled: list[str] = []
    compile_template = jinja2.Environment.compile

    def note(self: jinja2.Environment, source: str, name: str | None = None, *rest: Any, **more: Any) -> Any:
        compiled.append(str(name))
        return compile_template(self, source, name, *rest, **more)

    monkeypatch.setattr(jinja2.Environment, "compile", note)
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    monkeypatch.setattr(sys, "pycache_prefix", str(tmp_path / "kept"))
    folder = tmp_path / "templates"
    folder.mkdir()
    template = folder / "some.j2"

    def page(text: str) -> str:
        template.write_text(text)
        return page_environment(folder).get_template("some.j2").render(value="<")

    assert [page("a {{ value }}"), page("a {{ value }}"), page("b {{ value }}")] == ["a &lt;", "a &lt;", "b &lt;"]
    assert compiled == ["some.j2"] * 2, "it was changed once"

    (kept,) = (tmp_path / "kept").rglob("*.cache")
    kept.write_bytes(kept.read_bytes()[:16])  # cut off
    assert page("b {{ value }}") == "b &lt;"
    assert compiled == ["some.j2"] * 3

    (tmp_path / "file").touch()
    monkeypatch.setattr(sys, "pycache_prefix", str(tmp_path / "file"))  # no folder can be made there
    assert [page("b {{ value }}"), page("b {{ value }}")] == ["b &lt;"] * 2
    assert compiled == ["some.j2"] * 5


def test_compiled_templates_that_are_damaged_or_of_other_options_are_not_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    monkeypatch.setattr(sys, "pycache_prefix", str(tmp_path / "kept"))
    (tmp_path / "some.j2").write_text("a {{ value }}")

    def page(*, autoescape: bool = True) -> str:
        environment = page_environment(tmp_path)
        environment.autoescape = autoescape
        return environment.get_template("some.j2").render(value="<")

    assert page() == "a &lt;"
    (kept,) = (tmp_path / "kept").rglob("*.cache")
    whole = kept.read_bytes()
    for place in range(0, len(whole), 7):  # every byte is as good as another
        kept.write_bytes(whole[:place] + bytes([whole[place] ^ 0xFF]) + whole[place + 1 :])
        assert page() == "a &lt;", place
        assert kept.read_bytes() == whole, "it is written again"

    assert page(autoescape=False) == "a <"
    assert page() == "a &lt;"
