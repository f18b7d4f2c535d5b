"""The timeline of a run as a file that programs of the run may have changed."""

from pathlib import Path

from prefect_robomaker.tasks.runtime.episode.run_timeline import (
    TIMELINE_FILE,
    FilmTimes,
    MarginSeries,
    RunTimeline,
    add_videos,
    read_timeline,
    write_timeline,
)

CLIP = FilmTimes(begins_s=30.6, rate_hz=15, frames=151)


def test_videos_that_are_made_afterwards_join_what_is_there(tmp_path: Path) -> None:
    margins = [MarginSeries(requirement="soft", unit="N", samples=[(0.0, 5.0)])]
    whole = FilmTimes(begins_s=0, rate_hz=15, frames=610)
    write_timeline(RunTimeline(margins=margins, videos={"video.mp4": whole}), tmp_path)
    add_videos({"last-10s.mp4": CLIP}, tmp_path)
    found = read_timeline((tmp_path / TIMELINE_FILE).read_bytes())
    assert found.margins == margins
    assert found.videos == {"video.mp4": whole, "last-10s.mp4": CLIP}
    assert round(CLIP.ends_s, 3) == 40.667


def test_what_is_no_timeline_counts_as_an_empty_one(tmp_path: Path) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.write_text("mine")
    (tmp_path / TIMELINE_FILE).symlink_to(elsewhere)
    add_videos({"last-10s.mp4": CLIP}, tmp_path)
    assert elsewhere.read_text() == "mine", "a program's link is not followed"
    assert not (tmp_path / TIMELINE_FILE).is_symlink()
    assert read_timeline(b'{"margins": 3}') == read_timeline(b"") == RunTimeline()
