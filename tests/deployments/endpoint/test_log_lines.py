"""Logs as lines of JSON."""

import json
import logging

import pytest
from helpers.asgi import Client

from prefect_robomaker.deployments.endpoint.application import LOGGER, write_access_log
from prefect_robomaker.deployments.log_lines import log_formatter
from prefect_robomaker.schemas.wire.errors import ConfigurationError


def record(message: str, *arguments: object, **extra: object) -> logging.LogRecord:
    return logging.getLogger("a").makeRecord("a", logging.WARNING, "f", 1, message, arguments, None, extra=extra)


def test_a_line_of_json_has_time_level_logger_message_and_more() -> None:
    line = log_formatter({"ROBOMAKER_LOG_FORMAT": "json"}, "%(message)s").format(record("line 1\n%s", "ü", arn="x"))

    assert "\n" not in line
    told = json.loads(line)
    assert {**told, "time": None} == {
        "time": None, "level": "WARNING", "logger": "a", "message": "line 1\nü", "arn": "x",
    }  # fmt: skip


def test_lines_are_text_unless_json_is_asked_for() -> None:
    assert log_formatter({}, "%(message)s!").format(record("a")) == "a!"


def test_another_format_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="ROBOMAKER_LOG_FORMAT is 'xml'; it has to be text or json"):
        log_formatter({"ROBOMAKER_LOG_FORMAT": "xml"}, "")


def test_the_access_log_has_its_fields(
    client: Client, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("ROBOMAKER_LOG_FORMAT", "json")
    handler = write_access_log()
    try:
        client.call("ListWorlds")
    finally:
        LOGGER.removeHandler(handler)
    told = json.loads(capsys.readouterr().err)
    assert (told["operation"], told["status"], told["logger"]) == ("ListWorlds", 200, "robomaker.access")
