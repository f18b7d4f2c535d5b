from prefect_robomaker.schemas.reports.run_states import outcomes_in_words


def test_outcomes_are_counted_the_most_frequent_first() -> None:
    many = ["failed", *["passed"] * 3, "broken", "failed"]

    assert outcomes_in_words(many) == "6 jobs: 3 passed, 2 failed, 1 broken"
    assert outcomes_in_words(["passed"]) == "1 job: 1 passed"
    assert outcomes_in_words([]) == "0 jobs"
