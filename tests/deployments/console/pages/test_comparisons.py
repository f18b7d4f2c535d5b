"""Two runs side by side in the console: pairs that changed first, one plan for both paths, nothing hidden."""

import html
import re
from pathlib import Path
from typing import Any

import pytest
from helpers.driven_runs import content_of, drive, two_runs
from helpers.night_records import make_job, make_night, store_night

from prefect_robomaker.deployments.compared_pages import Sides, compared_page
from prefect_robomaker.schemas.reports.run_record import UsedApplication
from prefect_robomaker.schemas.runs.plan import Requirement
from prefect_robomaker.tasks.reporting.nights.beside import PairView
from prefect_robomaker.tasks.service.service import Service

pytestmark = pytest.mark.usefixtures("known_worlds")


@pytest.fixture
def worlds(generate: Any) -> list[str]:
    """ARNs of two worlds of two rooms."""
    count = {"floorplanCount": 2, "interiorCountPerFloorplan": 1}
    return generate(worldCount=count)["finishedWorldsSummary"]["succeededWorlds"]


def cards_of(page: str) -> list[str]:
    """The cards of a page's pairs."""
    return re.findall(r'<article class="card beside.*?</article>', page, re.DOTALL)


def test_both_paths_are_on_the_plan_of_their_world_with_what_changed(
    browser: Any, worlds: list[str], service: Service, tmp_path: Path
) -> None:
    steady = [drive(service, tmp_path, "P", world=worlds[0], night=night, index=1) for night in (0, 1)]
    before = drive(service, tmp_path, "P", world=worlds[1], night=0)
    after = drive(service, tmp_path, "F", world=worlds[1], night=1, end_s=6.0, margin=-3.5, video="video.mp4")
    broken = [drive(service, tmp_path, each, world=worlds[0], night=night, index=2, seed=9)
              for night, each in enumerate("PE")]  # fmt: skip
    alone = make_job(8, "P", night=1)
    runs = two_runs(
        service, [steady[0], before, broken[0]], [steady[1], after, broken[1], alone], parameters={"gain": "-1"}
    )

    page = html.unescape(browser.get(f"/console/compare?before={runs[0].run_id}&after={runs[1].run_id}").text)
    failing, crashed, same = cards_of(page)

    assert "2 of 3 pairs of jobs ended differently; they come first." in page
    assert "parameter gain: none → -1" in page
    assert "A: 2026-03-01 02:00, gain=none" in failing
    assert failing.count("data-times=") == 2
    assert "B first missed gentle at 3.0 s, wall" in failing
    assert failing.count('<g class="goal"') == 1
    assert f'src="/console/jobs/{after.label}/files/video.mp4"' in failing
    assert "No video: it was asked for failures only (on-failure)." in failing
    assert 'data-end="6.00"' in failing
    assert re.search(r"gentle.*?margin 2 N.*?margin -3.5 N.*?>worse<.*?newly missed", failing, re.DOTALL)
    assert re.search(r"there.*?>unchanged<", failing, re.DOTALL)
    assert "RobotApplicationCrash: ZeroDivisionError" in crashed
    assert re.search(r"gentle.*?>not comparable<.*?B broke", crashed, re.DOTALL)
    assert "changed" not in re.findall(r'<article class="([^"]*)"', same)[0]
    assert re.search(r"Without a partner.*?sim-1-8.*?>B<", page, re.DOTALL)
    assert page.count('id="beside-1-fixtures"') == page.count('id="beside-2-fixtures"') == 1
    assert "style=" not in page


def test_videos_begin_when_their_time_lines_say_so(
    browser: Any, worlds: list[str], service: Service, tmp_path: Path
) -> None:
    """A video that begins late, as one of a run that was resumed, and an old one, of which nothing says when."""
    late = drive(service, tmp_path, "P", world=worlds[0], night=0, video="last-10s.mp4", begins_s=1.25)
    old = drive(service, tmp_path, "F", world=worlds[0], night=1, video="video.mp4", begins_s=None)
    runs = two_runs(service, [late], [old])
    [card] = cards_of(browser.get(f"/console/compare?before={runs[0].run_id}&after={runs[1].run_id}").text)
    assert re.findall(r'<video [^>]*src="[^"]*/([^"/]+)"( data-begins="[^"]*")? data', card) == [
        ("last-10s.mp4", ' data-begins="1.25"'), ("video.mp4", ""),
    ]  # fmt: skip
    assert card.count("It does not follow: its simulated times are not recorded.") == 1


def test_trials_are_told_by_their_counts_and_nothing_is_drawn_of_them(browser: Any, service: Service) -> None:
    runs = service.settings.home / "runs"
    jobs = []
    for night, (letter, met, detail) in enumerate((("F", 4, "4 of 8 trials did not pass"), ("P", 8, "none failed"))):
        own = Requirement(name="trials", satisfied=letter == "P", detail=detail)
        goal = Requirement(
            name="there", kind="goal", satisfied=letter == "P", counts=False, margin=15.5, unit="s",
            detail=f"met in {met} of 8 trials",
        )  # fmt: skip
        job = make_job(0, letter, night=night, world=None).model_copy(update={"requirements": [own, goal]})
        jobs.append([job, make_job(1, "F" if night == 0 else "C", night=night, world=None)])
    before, after = (make_night(some, night, runs=runs) for night, some in enumerate(jobs))
    for record in (before, after):
        store_night(record)

    page = html.unescape(browser.get(f"/console/compare?before={before.run_id}&after={after.run_id}").text)
    trials, not_run = cards_of(page)

    assert re.search(r"there.*?met in 4 of 8 trials.*?met in 8 of 8 trials.*?>better<", trials, re.DOTALL)
    for word in ("margin", "does not count", "at no single moment", "<figure", 'class="player"'):
        assert word not in trials, word
    assert "4 of 8 trials did not pass" in trials
    assert "1 of 2 pairs of jobs ended differently; they come first. 1 pair was not run" in page
    assert ">not run</span>" in not_run
    assert "changed" not in re.findall(r'<article class="([^"]*)"', not_run)[0]


def test_cells_in_other_worlds_have_no_plan_in_common(
    browser: Any, worlds: list[str], service: Service, tmp_path: Path
) -> None:
    jobs = [drive(service, tmp_path, "P", world=each, night=0, index=index) for index, each in enumerate(worlds)]
    jobs = [
        job.model_copy(update={"axes": {"world": content_of(each, service)}})
        for job, each in zip(jobs, worlds, strict=True)
    ]
    run = make_night(jobs, runs=service.settings.home / "runs")
    store_night(run)

    address = f"/console/compare/cells?run={run.run_id}&step=drive&axis=world"
    [card] = cards_of(browser.get(f"{address}&first=0&other=1").text)

    assert "Not the same world: A drove in generation-0/world-1, B in generation-0/world-2." in card
    assert "<polyline" not in card
    assert 'class="plan"' not in card
    assert browser.get(f"{address}&first=0&other=2").status_code == 400
    assert browser.get(f"{address}&first=0&other=0").status_code == 404


def test_another_world_that_is_stored_instead_is_not_drawn(
    browser: Any, worlds: list[str], service: Service, tmp_path: Path
) -> None:
    jobs = [drive(service, tmp_path, "P", world=worlds[0], night=night) for night in (0, 1)]
    claimed = content_of(worlds[1], service)
    jobs = [job.model_copy(update={"inputs": job.inputs and job.inputs.model_copy(update={"world": claimed})})
            for job in jobs]  # fmt: skip
    runs = two_runs(service, jobs[:1], jobs[1:])
    [card] = cards_of(browser.get(f"/console/compare?before={runs[0].run_id}&after={runs[1].run_id}").text)

    assert "The world that is stored is not the one that both jobs drove in" in card
    assert "<polyline" not in card


def test_many_pairs_are_shown_page_by_page(browser: Any, service: Service) -> None:
    runs = service.settings.home / "runs"
    ids = []
    for night, letters in enumerate(("P" * 500, "P" * 499 + "F")):
        record = make_night(letters, night, runs=runs)
        store_night(record)
        ids.append(record.run_id)
    address = f"/console/compare?before={ids[0]}&after={ids[1]}"
    first, last = browser.get(address).text, browser.get(f"{address}&from=491").text

    assert "1 of 500 pairs of jobs ended differently" in first
    assert "sim-1-499" in cards_of(first)[0]
    assert len(cards_of(first)) == len(cards_of(last)) == 10
    assert "The job is deleted." in cards_of(first)[0]
    assert "from=11#beside" in first
    assert "Next pairs" not in last
    assert "sim-1-498" in cards_of(last)[-1]
    assert browser.get(f"{address}&from=501").status_code == 400


def test_the_page_of_a_run_leads_to_others_and_to_its_axes(browser: Any, service: Service) -> None:
    runs = service.settings.home / "runs"
    for night in range(3):
        jobs = [
            make_job(index, "P", night=night, world="flat").model_copy(update={"axes": {"robot": each}})
            for index, each in enumerate(("scout", "rover"))
        ]
        store_night(make_night(jobs, night, runs=runs))
    first, middle, last = sorted(folder.name for folder in runs.iterdir())
    page = html.unescape(browser.get(f"/console/runs/{middle}").text)
    offered = re.findall(r'<option value="([^"]+)"( selected)?', page)
    [link] = re.findall(r'href="(/console/compare/cells[^"]+)">rover<', page)
    cells = html.unescape(browser.get(link).text)

    assert offered == [(last, ""), (first, " selected")]
    assert f'<input type="hidden" name="after" value="{middle}">' in page
    assert "robot scout" in cells
    assert "the run's report says whether" in cells
    assert len(cards_of(cells)) == 1
    assert browser.get("/console/compare/cells?run=none&step=drive&axis=robot&first=0&other=1").status_code == 404
    assert browser.get(link.replace("robot", "gripper")).status_code == 404


def test_a_run_of_known_failures_alone_leads_to_others(browser: Any, service: Service) -> None:
    runs = service.settings.home / "runs"
    for night in range(2):
        job = make_job(0, "F", night=night).model_copy(update={"known": "anna until 2027-01-15: ticket 512"})
        store_night(make_night([job], night, runs=runs))
    before, after = sorted(folder.name for folder in runs.iterdir())

    assert f'<option value="{before}" selected' in browser.get(f"/console/runs/{after}").text


def test_without_a_world_paths_are_drawn_only_of_one_place_and_one_visitor_s_jobs(
    service: Service, tmp_path: Path
) -> None:
    def cards(digests: str, is_seen: bool = True, *, one_package: bool = False) -> list[PairView]:
        jobs = [
            drive(service, tmp_path / f"{digests}-{is_seen}-{one_package}", "P", world=None, night=night)
            for night in (0, 1)
        ]  # fmt: skip
        jobs = [
            job.model_copy(
                update={
                    "inputs": job.inputs
                    and job.inputs.model_copy(
                        update={"applications": [simulation(digest), *([robot(digest)] if one_package else [])]}
                    )
                }
            )
            for job, digest in zip(jobs, digests, strict=True)
        ]
        before, after = (make_night([job], night) for night, job in enumerate(jobs))
        sides = Sides.of_runs(before, after)
        return list(compared_page(sides, service, lambda *_: "", is_seen=lambda _: is_seen).cards)

    [same], [other], [hidden] = cards("aa"), cards("ab"), cards("cc", is_seen=False)
    [packed] = cards("ab", one_package=True)

    assert str(same.plan).count("data-times=") == 2
    assert "<use" not in str(same.plan)
    assert same.note == "The jobs drove in no generated world, so that there is no plan."
    assert other.plan is None
    assert "it is not known that their simulation applications are the same" in other.note
    assert packed.plan is None
    assert packed.note.startswith("Robot and simulation are one package, which differs between A and B")
    assert hidden.plan is None
    assert hidden.before.no_film == "This job is not shown to your access key."
    assert hidden.end_s == 0.0


def simulation(digest: str) -> UsedApplication:
    """A simulation application of some content."""
    return UsedApplication(role="simulation", name="arena", digest=digest)


def robot(digest: str) -> UsedApplication:
    """A robot application of some content."""
    return UsedApplication(role="robot", name="arena", digest=digest)


def test_changed_requirements_are_a_list_and_what_stands_in_backticks_is_code(browser: Any, service: Service) -> None:
    runs = service.settings.home / "runs"
    records = [make_night([make_job(0, letter, night=night)], night, runs=runs) for night, letter in enumerate("PF")]
    for record in records:
        store_night(record)
    page = browser.get(f"/console/compare?before={records[0].run_id}&after={records[1].run_id}").text
    [listed] = re.findall(r'<ul class="told-changes">(.*?)</section>', page, re.DOTALL)
    assert "<code>robomaker flaky</code> tells" in listed
    assert "`" not in listed
    last = browser.get(f"/console/runs/{records[1].run_id}").text.partition('id="since-title"')[2]
    assert "<code>robomaker flaky</code> tells" in last
    listed = last.partition("</section>")[0]
    assert f'<a href="/console/jobs/{records[1].jobs[0].label}">drive: world-1 scout, seed 7</a>' in listed


def test_a_trial_of_two_jobs_is_chosen_and_drawn_on_one_plan(
    browser: Any, worlds: list[str], service: Service, tmp_path: Path
) -> None:
    """Trial 0 passes in both, trial 2 only in A: it is shown first, and 0 if it is asked for."""
    jobs = [
        drive(service, tmp_path, letter, world=worlds[0], night=night, video="video.mp4", trials=trials)
        for night, (letter, trials) in enumerate((("P", {0: 2.0, 2: 1.0}), ("F", {0: 2.0, 2: -3.5})))
    ]
    runs = two_runs(service, jobs[:1], jobs[1:])
    address = f"/console/compare?before={runs[0].run_id}&after={runs[1].run_id}"
    [first], [other], [none] = (cards_of(browser.get(address + more).text) for more in ("", "&trial=0", "&trial=1"))

    assert "Shown is <strong>trial 2</strong>. A passed; B failed, gentle: 8.5 N" in html.unescape(first)
    assert first.count("data-times=") == 2
    assert "B first missed gentle at 2.0 s" in first
    assert f'src="/console/jobs/{jobs[1].label}/files/trials/000002/video.mp4" data-begins="0.0"' in first
    assert re.findall(r">(trial \d[^<]*)</a>", first) == ["trial 0", "trial 2, differs"]
    [link] = re.findall(r'href="([^"]*)">trial 0<', first)
    assert link == html.escape(f"{address}&from=1&pair=1&trial=0#pair-1")
    assert "Shown is <strong>trial 0</strong>. A passed; B passed." in other
    assert "first missed" not in other.partition("<title>")[2]
    assert "Shown is <strong>trial 2</strong>." in none, "of one that nobody recorded there is nothing to show"


def test_a_trial_that_one_job_did_not_record_says_how_to_get_its_path(
    browser: Any, worlds: list[str], service: Service, tmp_path: Path
) -> None:
    before = drive(service, tmp_path, "P", world=worlds[0], night=0, trials={0: 2.0})
    after = drive(service, tmp_path, "F", world=worlds[0], night=1, trials={2: -3.5})
    runs = two_runs(service, [before], [after])
    [card] = cards_of(browser.get(f"/console/compare?before={runs[0].run_id}&after={runs[1].run_id}").text)
    assert "Shown is <strong>trial 2</strong>." in card
    assert card.count("data-times=") == 1
    command = f"<code>robomaker repro {before.label} --trial 2</code>"
    assert f"A did not record trial 2, as it passed: {command} runs it again with a recording and a video." in card
    assert (
        "A: No video: the trial was not recorded, as it passed. B: No video: with <code>video: on-failure</code>"
        in card
    )
