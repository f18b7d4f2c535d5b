"""The policy: which runs are kept, for any runs and any rules."""

from datetime import UTC, datetime, timedelta

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from prefect_robomaker.schemas.reports.retention import RetentionPolicy
from prefect_robomaker.schemas.wire.errors import ConfigurationError
from prefect_robomaker.tasks.retention.policy import Candidate, named_by, why_kept

NOW = datetime(2026, 11, 23, 4, tzinfo=UTC)
AGES = st.integers(0, 9).map(lambda days: NOW - timedelta(days=days))
CANDIDATES = st.lists(
    st.builds(
        Candidate,
        id=st.text("abcdef", min_size=1, max_size=4),
        ended_at=AGES,
        group=st.none() | st.sampled_from(["night", "day"]),
        failed=st.booleans(),
        busy=st.sampled_from(["", "", "", "it runs"]),
        begun=st.sampled_from([False, False, True]),
    ),
    unique_by=lambda candidate: candidate.id,
    max_size=20,
)
POLICIES = st.builds(
    RetentionPolicy,
    older_than=st.none() | st.integers(0, 9).map(lambda days: timedelta(days=days)),
    keep_runs=st.none() | st.integers(0, 10),
    keep_failures=st.booleans(),
)


def removed(candidates: list[Candidate], policy: RetentionPolicy) -> set[str]:
    return {candidate.id for candidate in candidates} - why_kept(candidates, policy, NOW).keys()


@given(CANDIDATES, POLICIES)
def test_what_is_removed_breaks_no_rule(candidates: list[Candidate], policy: RetentionPolicy) -> None:
    gone = removed(candidates, policy)

    for candidate in candidates:
        if candidate.busy:
            assert candidate.id not in gone
        elif candidate.begun:
            assert candidate.id in gone
        elif candidate.id in gone:
            assert not (policy.keep_failures and candidate.failed)
            assert policy.older_than is None or candidate.ended_at < NOW - policy.older_than
            assert policy.older_than is not None or candidate.group is not None
            if policy.keep_runs is not None and candidate.group is not None:
                newer = [
                    each
                    for each in candidates
                    if each.group == candidate.group and not each.begun and each.ended_at >= candidate.ended_at
                ]
                assert len(newer) > policy.keep_runs


@given(CANDIDATES, POLICIES)
def test_what_is_kept_has_a_rule_that_keeps_it(candidates: list[Candidate], policy: RetentionPolicy) -> None:
    kept = why_kept(candidates, policy, NOW)

    assert all(kept.values())
    for candidate in candidates:
        if candidate.id in kept and not candidate.busy:
            newest = sorted(
                (each for each in candidates if each.group == candidate.group and not each.begun),
                key=lambda each: (each.ended_at, each.id),
                reverse=True,
            )[: policy.keep_runs or 0]
            assert (
                (candidate.group is not None and candidate in newest)
                or (policy.keep_failures and candidate.failed)
                or (policy.older_than is not None and candidate.ended_at >= NOW - policy.older_than)
                or (policy.older_than is None and (candidate.group is None or policy.keep_runs is None))
            )


@given(CANDIDATES, POLICIES, st.randoms())
def test_the_order_does_not_matter(candidates: list[Candidate], policy: RetentionPolicy, random: object) -> None:
    shuffled = list(candidates)
    random.shuffle(shuffled)  # type: ignore[attr-defined]

    assert why_kept(shuffled, policy, NOW) == why_kept(candidates, policy, NOW)


@given(CANDIDATES, POLICIES, st.integers(1, 9))
def test_a_stricter_rule_never_removes_more(candidates: list[Candidate], policy: RetentionPolicy, more: int) -> None:
    assume(policy.older_than is not None)
    assert policy.older_than is not None
    stricter = [
        policy.model_copy(update={"older_than": policy.older_than + timedelta(days=more)}),
        policy.model_copy(update={"keep_runs": (policy.keep_runs or 0) + more}),
        policy.model_copy(update={"keep_failures": True}),
    ]

    for each in stricter:
        assert removed(candidates, each) <= removed(candidates, policy)


@given(st.dictionaries(st.sampled_from("abcde"), st.sets(st.sampled_from("uvwxyz"))), st.sets(st.sampled_from("abcde")))
def test_what_something_kept_names_is_told(names: dict[str, set[str]], kept: set[str]) -> None:
    holders = named_by(names, kept)

    assert set(holders) == {name for holder in kept for name in names.get(holder, ())}
    assert all(holder in kept and name in names[holder] for name, holder in holders.items())


@pytest.mark.parametrize(
    ("policy", "advice"),
    [
        (RetentionPolicy(), "--older-than 30d"),
        (RetentionPolicy(keep_failures=True), "--keep-runs 20"),
        (RetentionPolicy(keep_runs=1, sdk_jobs=True), "--sdk-jobs goes by age"),
        (RetentionPolicy(keep_runs=1, orphaned_worlds=True), "--orphaned-worlds goes by age"),
    ],
)
def test_a_policy_that_would_remove_everything_is_refused(policy: RetentionPolicy, advice: str) -> None:
    with pytest.raises(ConfigurationError, match=advice):
        policy.check()
