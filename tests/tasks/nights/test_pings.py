"""Calls of a monitoring URL: the path and the line of text of a run that has ended."""

import pytest
from helpers.night_records import make_night
from helpers.receivers import Webhook

from prefect_robomaker.tasks.nights.pings import ping_end


@pytest.mark.parametrize(
    ("letters", "path", "word"), [("PP", "/", "passed"), ("PN", "/", "succeeded"), ("PF", "/fail", "failed")]
)
def test_the_text_has_the_word_of_the_runs_jobs(letters: str, path: str, word: str, webhook: Webhook) -> None:
    record = make_night(letters)
    complaints: list[str] = []

    ping_end(f"http://{webhook.address}/", record, complaints.append)

    assert (webhook.paths, complaints) == ([path], [])
    assert webhook.got == [{"text": f"{record.run_id}: {word}"}]
