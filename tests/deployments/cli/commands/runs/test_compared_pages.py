"""compare --report and --axis: two sides as a page that opens without a server, and as text."""

import itertools
import re
import shutil
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import pytest
from helpers.browser import NEEDS_BROWSER, browsing
from helpers.driven_runs import drive, two_runs
from helpers.night_records import digest, make_job, make_night, store_night

from prefect_robomaker.deployments import compared_pages
from prefect_robomaker.schemas.reports.report import ArmComparison
from prefect_robomaker.schemas.reports.run_record import JobRecord
from prefect_robomaker.tasks.comparison.arms import axis_results
from prefect_robomaker.tasks.comparison.compared_runs import NightRun
from prefect_robomaker.tasks.service.service import Service


@pytest.fixture
def home(service: Service) -> Path:
    """The data home of the service that has the jobs."""
    return service.settings.home


@pytest.fixture
def axes(home: Path) -> str:
    """A stored run of eight pairs of two robots; rover fails all but one."""
    jobs = [
        make_job(index, letter, world=f"flat {index}", seed=index).model_copy(
            update={"label": f"sim-{robot}-{index}", "axes": {"robot": robot}}
        )
        for robot, letters in (("scout", "PPPPPPPP"), ("rover", "FFFFFFFP"))
        for index, letter in enumerate(letters)
    ]
    run = make_night(jobs, runs=home / "runs")
    store_night(run)
    return run.run_id


def test_many_pairs_are_a_page_with_cards_of_those_that_changed(robomaker: Any, home: Path, tmp_path: Path) -> None:
    for night, letters in enumerate(("P" * 80, "P" * 79 + "F")):
        store_night(make_night(letters, night, runs=home / "runs"))
    first, second = sorted(folder.name for folder in (home / "runs").iterdir())
    page = tmp_path / "compared.html"
    told = robomaker("compare", first, second, "--report", page)
    text = page.read_text()

    assert told.code == 6
    assert told.out.endswith(f"  page          {page}\n")
    assert text.count('<article class="card beside') == 60
    assert text.index("sim-1-79") < text.index("sim-1-0<")
    assert re.search(r'Other pairs <span class="count">20<', text)
    assert "media-src data: file: " in text
    assert re.findall(r'(?:src|href)="(?!#|data:)[^"]*"', text) == []


def test_a_page_says_which_run_is_worse_and_which_is_newer(robomaker: Any, home: Path, tmp_path: Path) -> None:
    for night, letters in enumerate(("P" * 8, "F" * 8)):
        store_night(make_night(letters, night, runs=home / "runs"))
    first, second = sorted(folder.name for folder in (home / "runs").iterdir())
    page = tmp_path / "compared.html"
    robomaker("compare", first, second, "--report", page)
    assert "<strong>B passes less often than A, by more than chance</strong>" in page.read_text()
    assert "is the newer run" not in page.read_text()
    robomaker("compare", second, first, "--report", page)
    assert f"A, {second}, is the newer run: what changed since is told backwards." in page.read_text()


def test_two_values_of_an_axis_are_compared_within_one_run(robomaker: Any, axes: str, tmp_path: Path) -> None:
    page = tmp_path / "robots.html"
    told = robomaker("compare", axes, "--axis", "robot=rover", "--report", page)
    machine = robomaker("compare", "latest", "--axis", "drive.robot=rover", "-o", "json")

    assert told.code == machine.code == 1
    assert told.out.startswith(
        f"Passes less often: robot=rover compared with robot=scout, in {axes}.\n\n  how sure      8 pairs"
    )
    assert ArmComparison.model_validate_json(machine.out).answer == "worse"
    assert "7 of 8 pairs of jobs ended differently" in page.read_text()


def test_worlds_of_an_axis_are_found_by_the_names_that_people_see(robomaker: Any, home: Path) -> None:
    """Records name a world by its content, results of axes by its id, and people by its name."""
    jobs: list[JobRecord] = []
    for flat, letters in (("a", "PPPPPPPP"), ("b", "FFFFFFFP")):
        for seed, letter in enumerate(letters):
            job = make_job(seed, letter, world=f"content {flat}", seed=seed)
            assert job.inputs is not None
            named = {"label": f"sim-{flat}-{seed}", "world": f"world-{flat}", "world_name": f"flat {flat}"}
            jobs.append(job.model_copy(update={**named, "axes": {"flat": job.inputs.world}}))
    run = make_night(jobs, runs=home / "runs")
    store_night(run)
    told = robomaker("compare", run.run_id, "--axis", "flat=flat b")
    assert told.code == 1
    assert "Passes less often: flat=flat b compared with flat=flat a, in" in told.out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--axis", "gripper=x"), "--axis is 'gripper=x': 'gripper' is no axis of nightly-20260301T020000000"),
        (("--axis", "robot=husky"), "'husky' is no value beside the first one, scout; rover would be right"),
        (("latest", "--axis", "robot=rover"), "B is for two runs, and --axis compares two values within one"),
        (("--axis", "robot=rover", "--margin", "5"), "--margin is for two runs"),
        (("--axis", "robot=rover", "--alpha", "0.1"), "--alpha is for two runs"),
        ((), "B is missing, and no run of nightly before nightly-20260301T020000000 has results; name the run"),
        (("latest", "--open"), "--open shows the page of --report; name its file"),
        (("latest", "--report", "/nowhere/page.html"), "--report is /nowhere/page.html; it has to be a file"),
    ],
)  # fmt: skip
def test_wrong_words_are_named(robomaker: Any, axes: str, words: tuple[str, ...], said: str) -> None:
    told = robomaker("compare", axes, *words)
    assert told.code == 2
    assert said in told.err


@pytest.fixture
def filmed(service: Service, tmp_path: Path) -> list[str]:
    """Ids of two runs of a job in no world, which both have a video."""
    jobs = [
        drive(service, tmp_path, letter, world=None, night=night, end_s=3.0, video="video.mp4")
        for night, letter in enumerate("PF")
    ]
    return [run.run_id for run in two_runs(service, jobs[:1], jobs[1:])]


def test_videos_are_in_the_file_or_in_a_folder_beside_it(
    robomaker: Any, filmed: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file that somebody gets by mail has no files of the machine that wrote it."""
    page = tmp_path / "sent" / "two runs.html"
    page.parent.mkdir()
    robomaker("compare", *filmed, "--report", page)
    text = page.read_text()
    assert len(re.findall(r'<video [^>]*src="data:video/mp4;base64,', text)) == 2
    assert text.count('video.mp4 <span class="unit">in this file</span>') == 2
    assert "loads nothing: what it shows is in it" in text
    assert list(page.parent.iterdir()) == [page]

    size_bytes = max(path.stat().st_size for path in tmp_path.rglob("video.mp4"))
    monkeypatch.setattr(compared_pages, "_MOST_EMBEDDED_TOGETHER_BYTES", size_bytes)
    robomaker("compare", *filmed, "--report", page)
    text = page.read_text()
    sources = re.findall(r'<video [^>]*src="([^"]*)"', text)
    assert [source[:5] for source in sources] == ["data:", "two%2"], "together they are too large"
    assert (page.parent / unquote(sources[1])).read_bytes()[4:8] == b"ftyp"
    assert "<code>two runs-videos</code> beside it: send both together" in text
    assert "file:///" not in text


def test_a_folder_of_videos_that_cannot_be_written_is_told_and_not_taken_for_videos_that_are_gone(
    robomaker: Any, filmed: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(compared_pages, "_MOST_EMBEDDED_BYTES", 0)
    page, taken, theirs = tmp_path / "runs.html", tmp_path / "runs-videos", tmp_path / "theirs"
    taken.touch()
    told = robomaker("compare", *filmed, "--report", page)
    assert told.code == 2
    assert f"{taken} cannot be written" in told.err
    assert not page.exists()

    taken.unlink()
    robomaker("compare", *filmed, "--report", page)
    copied = sorted(taken.iterdir())
    theirs.write_text("mine")
    copied[0].unlink()
    copied[0].symlink_to(theirs)
    robomaker("compare", *filmed, "--report", page)
    assert sorted(taken.iterdir()) == copied
    assert copied[0].read_bytes()[4:8] == b"ftyp"
    assert theirs.read_text() == "mine", "a link is replaced, and nothing is written through it"


@pytest.mark.deep
@NEEDS_BROWSER
@pytest.mark.parametrize("most_bytes", [0, 3_000_000], ids=["beside", "inside"])
def test_the_file_plays_its_videos_wherever_it_is(
    robomaker: Any, filmed: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, most_bytes: int, home: Path
) -> None:
    monkeypatch.setattr(compared_pages, "_MOST_EMBEDDED_BYTES", most_bytes)
    made, sent = tmp_path / "made", tmp_path / "sent"
    made.mkdir()
    robomaker("compare", *filmed, "--report", made / "compared.html")
    shutil.move(made, sent)
    shutil.rmtree(home)
    page = sent / "compared.html"
    with browsing(tmp_path / "profile") as browser, browser.page() as tab:
        tab.load(page.as_uri(), 400)
        ready = "[...document.querySelectorAll('video')].every((each) => each.readyState > 1)"
        tab.wait(lambda tab: tab.evaluate(ready), "videos")
        move = "bar.value = 2; bar.dispatchEvent(new Event('input'))"
        tab.evaluate(f"(() => {{ const bar = document.querySelector('.player input'); {move}; }})()")
        times = "[...document.querySelectorAll('video')].map((each) => each.currentTime)"
        tab.wait(lambda tab: tab.evaluate(times) == pytest.approx([2.0, 2.0], abs=0.05), "both at two seconds")
        assert tab.evaluate("document.querySelectorAll('.way').length") > 2
        assert tab.evaluate("document.documentElement.scrollWidth") <= 400
        assert tab.complaints == []
        if most_bytes == 0:
            next(sent.rglob("*video.mp4")).unlink()
            tab.load(f"{page.as_uri()}?again", 1280)
            tab.wait_for_text("cannot be played here.")
            assert tab.text.count("cannot be played here.") == 1


@pytest.mark.deep
@NEEDS_BROWSER
@pytest.mark.parametrize("width", [400, 1280])
def test_labels_of_the_rates_are_as_large_as_text_on_every_screen(
    robomaker: Any, home: Path, tmp_path: Path, width: int
) -> None:
    """A drawing that is scaled to a telephone has labels that nobody can read."""
    runs = [make_night(letters, night, runs=home / "runs") for night, letters in enumerate(("PPPPPPPP", "PPFFFFFF"))]
    for run in runs:
        store_night(run)
    page = tmp_path / "compared.html"
    robomaker("compare", runs[0].run_id, runs[1].run_id, "--report", page)
    texts = "[...document.querySelectorAll('.chart text, .rate-names span')]"
    size_px = "parseFloat(getComputedStyle(each).fontSize) * (each.getScreenCTM ? each.getScreenCTM().a : 1)"
    with browsing(tmp_path / "profile") as browser, browser.page() as tab:
        tab.load(page.as_uri(), width)
        sizes = tab.evaluate(f"{texts}.map((each) => {size_px})")
        boxes = tab.evaluate(f"{texts}.map((each) => each.getBoundingClientRect().toJSON())")
        assert len(sizes) == 7  # before, after, and 0 to 100 %
        assert min(sizes) >= 11
        assert tab.evaluate("document.querySelector('.chart.compared').getBoundingClientRect().height") >= 80
        assert all(box["left"] >= 0 and box["right"] <= width for box in boxes)
        assert not any(_overlap(one, other) for one, other in itertools.combinations(boxes, 2))
        assert tab.evaluate("document.documentElement.scrollWidth") <= width


def _overlap(one: dict[str, float], other: dict[str, float]) -> bool:
    across = one["left"] < other["right"] and other["left"] < one["right"]
    return across and one["top"] < other["bottom"] and other["top"] < one["bottom"]


def test_worlds_of_an_axis_are_named_as_in_the_report_and_have_its_answer(robomaker: Any, home: Path) -> None:
    worlds = {digest(name): name for name in ("flat 1", "flat 2")}
    jobs = [
        make_job(index, letter, world=name, seed=index).model_copy(
            update={
                "label": f"sim-{name[-1]}-{index}",
                "axes": {"place": content},
                "world": f"generation-0/world-{name[-1]}",
                "world_name": name,
            }
        )
        for (content, name), letter in zip(worlds.items(), "PF", strict=True)
        for index in range(8)
    ]
    run = make_night(jobs, runs=home / "runs")
    store_night(run)
    [axis] = axis_results(NightRun.of(run), {}, between_worlds=True)
    [arm] = axis.comparisons

    told = robomaker("compare", run.run_id, "--axis", f"place={arm.value}")
    by_name = robomaker("compare", run.run_id, "--axis", "place=flat 2", "-o", "json")

    assert told.code == by_name.code == 1
    assert ArmComparison.model_validate_json(by_name.out) == arm


def test_values_that_change_no_state_are_told(robomaker: Any, service: Service, tmp_path: Path) -> None:
    jobs = [
        drive(service, tmp_path, "P", world=None, night=0, index=index, states="a" * 64).model_copy(
            update={"axes": {"robot": robot}}
        )
        for index, robot in enumerate(("scout", "rover"))
    ]
    run = make_night(jobs, runs=service.settings.home / "runs")
    store_night(run)
    told = robomaker("compare", run.run_id, "--axis", "robot=rover")
    assert "both sides of each pair went through the same states" in told.out


def test_values_that_look_alike_are_not_taken_for_each_other(robomaker: Any, home: Path) -> None:
    jobs = [
        make_job(0, letter, world="flat").model_copy(update={"label": f"sim-{index}", "axes": {"gain": value}})
        for index, (value, letter) in enumerate(((2.0, "P"), (1.0, "P"), ("1", "F")))
    ]
    run = make_night(jobs, runs=home / "runs")
    store_night(run)
    told = robomaker("compare", run.run_id, "--axis", "gain=1")
    assert (told.code, told.out) == (2, "")
    assert "several values of gain look like '1'" in told.err
