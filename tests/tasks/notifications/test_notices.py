"""Messages about runs, with what they have of the runs before."""

from helpers.night_records import make_night, store_night
from helpers.receivers import Webhook

from prefect_robomaker.schemas.reports.run_record import BEFORE_STEPS, RunRecord, StepRecord
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.notifications.notices import notify_of


def test_a_job_that_is_gone_is_told_once_and_not_by_nights_that_are_refused(
    settings: Settings, webhook: Webhook
) -> None:
    runs = settings.home / "runs"
    told = settings.model_copy(update={"notify": (f"json://{webhook.address}/hook",)})
    step = StepRecord(name=BEFORE_STEPS, operation="RunPipeline", status="Failed", error="there is no such robot")
    refused = {"state": "broken", "steps": [step]}

    def message(record: RunRecord) -> str:
        store_night(record)
        notify_of(record, told, None, print)
        return webhook.got[-1]["title"]

    store_night(make_night("PP", 0, runs=runs))
    assert "1 job gone" in message(make_night("F", 1, runs=runs))
    for night in (2, 3):
        assert "job gone" not in message(make_night("", night, runs=runs).model_copy(update=refused))
