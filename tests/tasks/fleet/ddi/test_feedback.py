import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.wire.errors import InvalidParameterException
from prefect_robomaker.tasks.fleet.ddi.received_reports import (
    MAX_DETAIL_CHARACTERS,
    MAX_DETAILS,
    Execution,
    Feedback,
    Finished,
    OrderEnd,
    parse_attributes,
    parse_feedback,
)


def body(**status: Any) -> bytes:
    return json.dumps({"status": {"execution": "proceeding", "result": {"finished": "none"}, **status}}).encode()


AS_SWUPDATE = b"""{"id": "8", "time": "20261123T144406", "status": {"result": {"progress": {"of": 1, "cnt": 0},
    "finished": "none"}, "execution": "proceeding", "details": ["Installing Update Chunk Artifacts."]}}"""


def test_what_swupdate_sends_is_read() -> None:
    details = ("Installing Update Chunk Artifacts.",)

    assert parse_feedback(8, AS_SWUPDATE) == Feedback(8, Execution.PROCEEDING, Finished.NONE, 0, 1, None, details)


@pytest.mark.parametrize(
    ("execution", "finished", "order_end", "cancel_end"),
    [
        ("closed", "success", OrderEnd.FINISHED, OrderEnd.CANCELED),
        ("closed", "none", OrderEnd.FINISHED, OrderEnd.CANCELED),
        ("closed", "failure", OrderEnd.FAILED, OrderEnd.FAILED),
        ("canceled", "none", OrderEnd.CANCELED, OrderEnd.CANCELED),
        ("rejected", "failure", None, None),
        ("proceeding", "success", None, None),
        ("downloaded", "none", None, None),
        ("scheduled", "none", None, None),
        ("resumed", "none", None, None),
    ],
)
def test_what_ends_an_order_is_what_hawkbit_takes_for_its_end(
    execution: str, finished: str, order_end: OrderEnd | None, cancel_end: OrderEnd | None
) -> None:
    feedback = parse_feedback(1, body(execution=execution, result={"finished": finished}))

    assert (feedback.order_end, feedback.cancel_end) == (order_end, cancel_end)


@given(
    st.sampled_from(list(Execution)),
    st.sampled_from(list(Finished)),
    st.none() | st.integers(-(2**31) + 1, 2**31 - 1),
    st.lists(st.text(max_size=MAX_DETAIL_CHARACTERS), max_size=MAX_DETAILS),
    st.none() | st.integers(0, 2**31 - 1),
)
def test_every_feedback_is_read_as_it_was_meant(
    execution: Execution, finished: Finished, code: int | None, details: list[str], count: int | None
) -> None:
    result = {"finished": finished, "progress": {"cnt": count, "of": count}}
    read = parse_feedback(5, body(execution=execution, result=result, code=code, details=details, more=[1]))

    assert (read.action_id, read.execution, read.finished, read.code) == (5, execution, finished, code)
    assert (read.count, read.of) == (count, count)
    assert [len(each) for each in read.details] == [len(each) for each in details]
    for got, sent in zip(read.details, details, strict=True):
        assert got == sent or any(each < " " or "\ud800" <= each <= "\udfff" for each in sent)
        got.encode()
        assert "\0" not in got, "databases refuse it"


JSON = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.sampled_from(["status", "result", "execution", "data"]), inner),
)


@given(st.binary() | JSON.map(lambda value: json.dumps(value).encode()))
def test_whatever_else_is_sent_is_refused_in_one_way(sent: bytes) -> None:
    for parse in (lambda content: parse_feedback(1, content), parse_attributes):
        try:
            parse(sent)
        except InvalidParameterException as error:
            message = str(error)
        else:
            continue
        assert 0 < len(message) < 400


@pytest.mark.parametrize(
    ("sent", "words"),
    [
        (b"", "the body is no JSON"),
        (b"\xff", "UTF-8"),
        (b"[" * 100_000, "nested too deeply"),
        (b"[]", "the body: []"),
        (b"{}", "status is missing; an object"),
        (body(execution="done"), "status.execution: 'done' is not right; it has to be one of 'closed', 'proceed"),
        (body(result={"finished": True}), "status.result.finished: True"),
        (body(result={"finished": "none", "progress": {"cnt": -1}}), "status.result.progress.cnt: -1"),
        (body(result={"finished": "none", "progress": {"of": True}}), "status.result.progress.of: True"),
        (body(code=2**31), "status.code: 2147483648"),
        (body(details=["a", 5]), "status.details[1]: 5"),
        (body(details=["a"] * 51), "status.details: 51 texts; at most 50"),
    ],
)
def test_an_error_names_place_value_and_what_is_right(sent: bytes, words: str) -> None:
    with pytest.raises(InvalidParameterException) as refused:
        parse_feedback(1, sent)

    assert words in str(refused.value)


def test_long_details_keep_their_beginning() -> None:
    (detail,) = parse_feedback(1, body(details=["abc" * 1000])).details

    assert detail == ("abc" * 1000)[:512]


def test_characters_that_databases_and_terminals_do_not_take_are_replaced() -> None:
    sent = body(details=["a\0b\x1b[31m\ud800", "line\n\ttext é"])

    assert parse_feedback(1, sent).details == ("a\ufffdb\ufffd[31m\ufffd", "line\n\ttext é")


def test_attributes_are_texts_with_a_mode() -> None:
    read = parse_attributes(b'{"mode": "replace", "data": {"hw": "demo:1.0"}, "id": ""}')

    assert (read.mode, read.values) == ("replace", {"hw": "demo:1.0"})
    assert parse_attributes(b'{"data": {}}').mode == "merge"


@pytest.mark.parametrize(
    ("sent", "words"),
    [
        (b'{"mode": "add", "data": {}}', "mode: 'add'"),
        (b'{"data": {"a": 1}}', "data.a: 1"),
        (b'{"data": {"": "x"}}', "data.: 'x'"),
        (json.dumps({"data": {"a": "x" * 129}}).encode(), "at most 128 characters"),
        (json.dumps({"data": {str(number): "" for number in range(101)}}).encode(), "101 attributes; at most 100"),
    ],
)
def test_attributes_of_other_shapes_are_refused(sent: bytes, words: str) -> None:
    with pytest.raises(InvalidParameterException) as refused:
        parse_attributes(sent)

    assert words in str(refused.value)
