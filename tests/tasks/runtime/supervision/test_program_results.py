"""Results of programs count, also where their file is not quite a result."""

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.runs.plan import RunResult
from prefect_robomaker.tasks.runtime.supervision.finished_outputs import ProgramResult, read_program_result

FACTS: dict[str, Any] = {
    "sim_time_s": 0.0, "wall_time_s": 2.0, "real_time_factor": 0.0, "ended_by": "application", "seed": 1,
}  # fmt: skip


def read(folder: Path, content: bytes) -> ProgramResult:
    (folder / "result.json").write_bytes(content)
    return read_program_result(folder, FACTS)


def test_no_file_is_no_problem(tmp_path: Path) -> None:
    assert read_program_result(tmp_path, FACTS) == ProgramResult()


def test_a_whole_result_is_taken_as_it_is(tmp_path: Path) -> None:
    whole = RunResult(verdict="PASS", **FACTS)
    said = read(tmp_path, whole.model_dump_json().encode())
    assert (said.result, said.is_changed) == (whole, False)


@pytest.mark.parametrize(
    "content",
    [
        json.dumps({"verdict": "FAIL", **FACTS, "robot": "rover"}).encode(),
        b'{"verdict": "FAIL"}',
        b"\xef\xbb\xbf" + json.dumps({"verdict": "FAIL", **FACTS}).encode(),
    ],
    ids=["a member more", "a verdict only", "a byte order mark"],
)
def test_a_result_that_is_nearly_one_says_what_it_says(tmp_path: Path, content: bytes) -> None:
    said = read(tmp_path, content)
    assert said.is_changed
    assert said.result is not None
    assert said.result.verdict == "FAIL"
    assert said.result.wall_time_s == 2.0


def test_members_that_a_result_does_not_have_are_kept(tmp_path: Path) -> None:
    said = read(tmp_path, b'{"verdict": "PASS", "robot": "rover", "extra": {"a": 1}}')
    assert said.result is not None
    assert said.result.extra == {"a": 1, "robot": "rover"}


def test_numbers_that_are_not_finite_are_kept_as_text(tmp_path: Path) -> None:
    said = read(tmp_path, b'{"verdict": "PASS", "metrics": {"speed": NaN, "far": Infinity, "near": 1.5}}')
    assert said.result is not None
    assert said.result.metrics == {"near": 1.5}
    assert said.result.extra == {"not_finite": {"speed": "nan", "far": "inf"}}
    assert RunResult.model_validate_json(said.result.model_dump_json()) == said.result


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (b"PASS", "result.json is no result: Expecting value"),
        (b"[]", "it has no `verdict` of PASS, FAIL, ERROR, NONE"),
        (b'{"verdict": "pass"}', "it has no `verdict` of PASS, FAIL, ERROR, NONE"),
        (b'{"verdict": "PASS", "metrics": {"a": "fast"}}', "metrics.a: "),
        (b'{"verdict": "PASS", "sim_time_s": NaN}', "a number in it is not finite"),
    ],
)
def test_what_is_no_result_says_why(tmp_path: Path, content: bytes, problem: str) -> None:
    said = read(tmp_path, content)
    assert said.result is None
    assert problem in (said.problem or "")


@given(st.binary(max_size=60))
def test_any_bytes_are_a_result_or_a_problem(tmp_path_factory: pytest.TempPathFactory, content: bytes) -> None:
    said = read(tmp_path_factory.mktemp("left"), content)
    assert (said.result is None) != (said.problem is None)
