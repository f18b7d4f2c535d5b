"""Deciding while a run goes on: order of the pairs, what broke, worlds, margins, and when nothing can be decided."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.reports.live_comparison import Against
from prefect_robomaker.tasks.comparison.early_stops import Decision, PairedTrials, decide, told_decision

ASKED = Against(run_id="old", alpha=0.05)
MARGIN = Against(run_id="old", alpha=0.05, margin=0.1)


def codes(letters: str) -> np.ndarray:
    """Outcomes: passed, failed, broken, no verdict, canceled or missing."""
    return np.array(["PFENC".index(letter) for letter in letters], dtype=np.int8)


def job(before: str, after: str | None = None, world: str = "", *, is_fair: bool = True) -> PairedTrials:
    return PairedTrials(world, codes(before), None if after is None else codes(after), is_fair)


def jobs(before: str, after: str) -> list[PairedTrials]:
    """A job for each letter; a dot has not ended."""
    return [job(old, None if new == "." else new) for old, new in zip(before, after, strict=True)]


def test_it_is_decided_by_the_first_pairs_that_are_enough() -> None:
    better = decide(jobs("F" * 12, "P" * 12), ASKED)
    assert (better.answer, better.pairs, better.planned) == ("better", 8, 12)
    worse = decide(jobs("P" * 12, "F" * 8 + "...."), ASKED)
    assert (worse.answer, worse.pairs) == ("worse", 8)
    assert decide(jobs("F" * 12, "P" * 7 + "....."), ASKED).answer is None
    same = decide(jobs("PF" * 40, "PF" * 40), ASKED)
    assert (same.answer, same.pairs, same.judged) == (None, 80, 80)


def test_jobs_that_end_first_do_not_get_in_front() -> None:
    """A worse robot that passes its easy jobs at once, while the hard ones still run, is not better."""
    easy_first = [*jobs("P" * 10, "." * 10), *jobs("F" * 20, "P" * 20)]
    found = decide(easy_first, ASKED)
    assert (found.answer, found.pairs) == (None, 0)
    assert decide([*jobs("P" * 20, "F" * 20), *jobs("F" * 20, "P" * 20)], ASKED).answer == "worse"


@pytest.mark.parametrize("lost", "ENC")
def test_what_broke_or_is_missing_does_not_pass(lost: str) -> None:
    all_lost = decide(jobs("F" * 20, lost * 20), ASKED)
    assert (all_lost.answer, all_lost.judged) == (None, 0)
    open_question = decide(jobs("P" * 20, lost * 20), ASKED)
    assert (open_question.answer, open_question.depends_on_lost) == (None, True), "worse only where lost is failed"
    better = decide(jobs("F" * 8 + "P" * 6, "P" * 8 + lost * 6), ASKED)
    assert better.answer == "better", "the first eight pairs had decided it"
    hidden = decide(jobs("P" * 6 + "F" * 8, lost * 6 + "P" * 8), ASKED)
    assert (hidden.answer, hidden.depends_on_lost) == (None, True)
    assert decide(jobs("P" * 60, "P" * 20 + lost * 40), MARGIN).answer is None


def test_copies_of_one_pair_decide_nothing() -> None:
    """Seeds that change nothing repeat one pair, state by state: 32 copies are one, as in `compare`."""
    copy = PairedTrials("", codes("F"), codes("P"), before_states=("a",), after_states=("b",))
    found = decide([copy] * 32, ASKED)
    assert (found.answer, found.pairs, found.judged, found.repeated) == (None, 32, 1, 31)
    assert told_decision(ASKED, found, is_over=True).why == (
        "not decided after 32 of 32 pairs; 31 pairs repeat another pair state by state and do not count"
    )
    decided = decide([*[copy] * 32, *jobs("F" * 12, "P" * 12)], ASKED)
    assert (decided.answer, decided.pairs, decided.judged) == ("better", 39, 8), "seven others"
    worlds = [
        PairedTrials(f"world {number}", codes("FF"), codes("PP"), before_states=("a", "a"), after_states=("b", "b"))
        for number in range(12)
    ]
    assert (decide(worlds, ASKED).answer, decide(worlds, ASKED).judged) == ("better", 8), "each world counts"


def test_a_pair_that_was_judged_otherwise_hides_none_that_was_judged_alike() -> None:
    """The first of two copies counts; one by other requirements is no copy of one by the same."""
    alike = PairedTrials("", codes("F"), codes("P"), before_states=("a",), after_states=("b",))
    otherwise = PairedTrials("", codes("F"), codes("P"), False, before_states=("a",), after_states=("b",))
    assert decide([otherwise, alike], ASKED).judged == 1


def test_other_requirements_are_no_verdict_and_with_a_margin_no_pass() -> None:
    other = [job("P", "P", is_fair=False) for _ in range(60)]
    assert (decide(other, ASKED).answer, decide(other, ASKED).judged) == (None, 0)
    assert decide([*other, *jobs("P" * 60, "P" * 60)], MARGIN).answer is None
    assert decide(jobs("P" * 60, "P" * 60), MARGIN).answer == "not worse"


def test_with_a_margin_jobs_that_are_gone_could_be_the_fall() -> None:
    gone = [job("P") for _ in range(10)]
    assert decide(jobs("P" * 60, "P" * 60), MARGIN, gone).answer is None
    assert decide(jobs("P" * 400, "P" * 400), MARGIN, gone).answer == "not worse"
    assert decide(jobs("F" * 12, "P" * 12), ASKED, gone).answer == "better"


def test_whole_worlds_count_where_there_are_enough() -> None:
    worlds = [job("F" * 4, "P" * 4, f"world {number}") for number in range(12)]
    found = decide(worlds, ASKED)
    assert (found.answer, found.worlds, found.pairs, found.planned) == ("better", 8, 32, 48)
    one = decide([job("F" * 40, "P" * 40, "world")], ASKED)
    assert (one.answer, one.worlds, one.pairs) == ("better", None, 8)


def test_a_world_counts_when_all_its_jobs_have_ended() -> None:
    begun = [job("F", "P", f"world {number}") for number in range(12)]
    waits = [job("F", None, f"world {number}") for number in range(12)]
    assert (decide([*begun, *waits], ASKED).answer, decide([*begun, *waits], ASKED).pairs) == (None, 0)
    ended = [job("F", "P", f"world {number}") for number in range(12)]
    assert decide([*begun, *ended], ASKED).answer == "better"


@pytest.mark.parametrize(
    ("before", "after", "hopeless"),
    [
        ("F" * 7, "." * 7, True),  # seven pairs are too few, whatever comes
        ("F" * 8, "." * 8, False),
        ("F" * 20, "F" * 13 + "." * 7, True),
        ("F" * 20, "F" * 12 + "." * 8, False),
        ("PPPPFFFF" * 3, "PPPPFFFF" + "." * 16, False),
        ("PPPPFFFF" * 2, "PPPPFFFF" + "." * 8, True),  # four can get better, four can get worse: too few of each
    ],
)
def test_pairs_that_are_left_may_not_be_enough(before: str, after: str, hopeless: bool) -> None:
    assert decide(jobs(before, after), ASKED).is_hopeless == hopeless


letters = st.sampled_from(["P", "F", "E", "N", "C"])


@given(st.lists(st.tuples(letters, letters), min_size=1, max_size=40), st.sampled_from([ASKED, MARGIN]), st.data())
def test_what_has_been_decided_stays_and_what_was_hopeless_is_not_decided_later(
    pairs: list[tuple[str, str]], asked: Against, data: st.DataObject
) -> None:
    def at(count: int) -> Decision:
        return decide([job(old, new if place < count else None) for place, (old, new) in enumerate(pairs)], asked)

    count = data.draw(st.integers(0, len(pairs)))
    early, late = at(count), at(len(pairs))
    if early.answer is not None:
        assert (late.answer, late.pairs, late.e_values) == (early.answer, early.pairs, early.e_values)
    if early.is_hopeless:
        assert late.answer is None
