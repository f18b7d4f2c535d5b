"""Runs that were looked at while they ran: what they found out is not tested again, and not with other runs."""

from typing import Any

import pytest
from helpers.night_records import make_night

from prefect_robomaker.schemas.reports.comparison import Comparison
from prefect_robomaker.schemas.reports.live_comparison import AgainstAnswer, in_words
from prefect_robomaker.schemas.reports.run_exit_codes import exit_code_of
from prefect_robomaker.tasks.comparison.better_or_worse import compare
from prefect_robomaker.tasks.comparison.compared_runs import NightRun
from prefect_robomaker.tasks.comparison.history import history_of

OLD, NEW, OTHER = (make_night("FFFFFFFF", number).run_id for number in range(3))


def answer(**changes: Any) -> AgainstAnswer:
    given = {
        "run_id": OLD, "alpha": 0.05, "answer": "better", "why": "decided after 8 of 20 pairs", "pairs": 8,
        "planned": 20, "saved": 10, "stopped_early": True, "e_values": {"better": 68.0, "worse": 0.4},
    }  # fmt: skip
    return AgainstAnswer.model_validate({**given, **changes})


def looked_at(verdicts: str, found: AgainstAnswer | None, night: int = 1) -> NightRun:
    return NightRun.of(make_night(verdicts, night).model_copy(update={"against": found}))


def compared(after: NightRun, before: NightRun | None = None, **options: Any) -> Comparison:
    return compare(before or NightRun.of(make_night("F" * 8)), after, **options)


def test_the_answer_is_that_of_its_e_values_and_no_test_of_what_is_left() -> None:
    found = compared(looked_at("PPPPPPPPCC", answer()))
    assert (found.answer, found.exit_code, found.rate, found.needed) == ("better", 0, None, None)
    assert found.why == "decided after 8 of 20 pairs (e-values: better 68, worse 0.4; 40 decide at alpha 0.05)"
    assert found.e_values == {"better": 68.0, "worse": 0.4}
    undecided = answer(answer="no difference shown", why="not decided after 8 of 8 pairs", e_values={})
    assert compared(looked_at("PPPPPPPP", undecided)).answer == "no difference shown", "though McNemar's p is 0.008"


@pytest.mark.parametrize(
    ("alpha", "told"), [(0.05, "better"), (0.1, "better"), (0.03, "better"), (0.02, "no difference shown")]
)
def test_another_error_probability_takes_other_evidence(alpha: float, told: str) -> None:
    assert compared(looked_at("PPPPPPPPCC", answer()), alpha=alpha).answer == told


def test_another_margin_is_another_question() -> None:
    found = compared(looked_at("PPPPPPPPCC", answer()), margin=0.1)
    assert (found.answer, found.exit_code) == ("not comparable", 7)
    assert "was carried out against" in found.why
    asked = answer(margin=0.1, answer="not worse", e_values={"better": 1.0, "not worse": 41.0, "worse": 1.0})
    assert compared(looked_at("PPPPPPPPCC", asked), margin=0.1).answer == "not worse"


def test_a_run_that_stopped_early_is_not_compared_with_others() -> None:
    other = NightRun.of(make_night("F" * 8, 2))
    stopped = looked_at("PPPPPPPPCC", answer())
    for before, after in ((other, stopped), (stopped, other)):
        found = compared(after, before)
        assert (found.answer, found.exit_code, found.rate) == ("not comparable", 7, None)
        assert found.why.startswith(f"run {NEW} stopped early against run {OLD}")
    unpaired = looked_at("PPPPPPPPCC", answer(planned=8, saved=0, unpaired=2))
    assert compared(unpaired, other).answer == "not comparable", "the answer chose which jobs there are"
    whole = looked_at("PPPPPPPP", answer(saved=0, stopped_early=False))
    assert compared(whole, other).answer == "better", "nothing of it is missing"


def test_history_says_the_answer_and_no_interval() -> None:
    runs = [NightRun.of(make_night("F" * 8)), looked_at("PPPPPPPPCC", answer())]
    history = history_of("nightly", runs)
    assert [night.success.low is None for night in history.nights] == [False, True]
    unpaired = looked_at("PPPPPPPPCC", answer(planned=8, saved=0, unpaired=2))
    assert history_of("nightly", [runs[0], unpaired]).nights[1].success.low is None
    assert history.nights[1].against == f"better than {OLD}: decided after 8 of 20 pairs; 10 trials saved"
    assert not history.since_last.has_losses


@pytest.mark.parametrize(
    ("state", "told", "code"),
    [
        ("succeeded", "better", 0),
        ("failed", "better", 0),  # its own requirements are missed, less often than before
        ("failed", "not worse", 0),
        ("failed", "worse", 1),
        ("succeeded", "worse", 1),
        ("succeeded", "no difference shown", 6),
        ("failed", "not comparable", 7),
        ("broken", "better", 3),
        ("canceled", "better", 4),
        ("timed out", "no difference shown", 5),
    ],
)
def test_the_answer_is_the_exit_code_of_a_run_that_came_to_its_end(state: Any, told: Any, code: int) -> None:
    assert exit_code_of(state, answer(answer=told)) == code


def test_answers_in_a_line() -> None:
    assert in_words(answer(saved=1)) == f"better than {OLD}: decided after 8 of 20 pairs; 1 trial saved"
    beyond = in_words(answer(why="decided after 8 of 8 pairs", saved=0, unpaired=27, skipped=["after", "tidy"]))
    assert beyond == (
        f"better than {OLD}: decided after 8 of 8 pairs; 27 jobs without a pair were not run; "
        "not run since it was decided: after, tidy"
    )
    assert in_words(answer(unpaired=1)).endswith("; 10 trials saved; 1 job without a pair was not run")
    hopeless = answer(answer="no difference shown", saved=3, skipped=[f"drive_{part}_of_11" for part in range(2, 12)])
    assert "; 3 trials saved; not run since it could not be decided any more: drive_2_of_11, " in in_words(hopeless)
    assert in_words(hopeless).endswith("drive_9_of_11 and 2 more")
    assert in_words(answer(answer="no difference shown", saved=0)).startswith(f"no difference from {OLD} shown: ")
