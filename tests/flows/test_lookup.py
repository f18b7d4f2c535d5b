"""Calling flows from code that is no flow."""

from prefect.settings import PREFECT_FLOWS_HEARTBEAT_FREQUENCY, get_current_settings, temporary_settings

from prefect_robomaker.flows.lookup import without_heartbeat


def test_heartbeats_are_turned_off_once() -> None:
    with temporary_settings({PREFECT_FLOWS_HEARTBEAT_FREQUENCY: 30}):
        with without_heartbeat():
            assert PREFECT_FLOWS_HEARTBEAT_FREQUENCY.value() is None
            settings = get_current_settings()
            with without_heartbeat():
                assert get_current_settings() is settings, "a pipeline has done it for its steps"
        assert PREFECT_FLOWS_HEARTBEAT_FREQUENCY.value() == 30
