"""Reruns of a job: what is asked of the machine before them."""

import pytest

from prefect_robomaker.tasks.flakiness import trials


def test_a_machine_that_does_not_say_in_time_whether_it_has_boxes_has_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trials, "_BOX_TIMEOUT_S", 0.001)  # no interpreter starts so fast
    assert not trials._has_boxes()


def test_a_machine_that_cannot_be_asked_has_no_boxes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trials.sys, "executable", "/nowhere/python")
    assert not trials._has_boxes()
    monkeypatch.undo()
    monkeypatch.setattr(trials, "_LEVELS", "no_such_module")
    assert not trials._has_boxes()
