"""Words for what decides how a flaky job ends."""

from prefect_robomaker.schemas.runs.verification import Flakiness, TriedHold


def test_what_decides_is_shown_by_reruns_with_and_without_it() -> None:
    tried = [
        TriedHold(held=[], ends={"FAIL": 1}, ways=1),
        TriedHold(held=["hash", "time"], ends={"PASS": 2}, ways=1),
        TriedHold(held=["hash"], ends={"PASS": 3}, ways=1),
        TriedHold(held=["time"], ends={"PASS": 1, "FAIL": 2}, ways=3),
    ]
    found = Flakiness(
        job="arn", name="driver", answer="decided", decides="hash", probability=0.96, side="robot", verdict="PASS",
        tried=tried,
    )  # fmt: skip
    assert str(found).splitlines()[:4] == [
        "driver: the verdict flips: FAIL in 1, PASS in 1 of 2 with the run itself",
        "  The order of hashes and addresses decides (96%).",
        "  With one PYTHONHASHSEED and fixed addresses: PASS in 5 of 5.",
        "  Without, while others were held: FAIL in 2, PASS in 1 of 3, which went 3 different ways.",
    ]


def test_a_job_that_repeats_says_what_was_not_varied_and_what_its_reruns_could_miss() -> None:
    """0.95^10 is 0.60, and 0.95^59 the first below 0.05."""
    tried = [TriedHold(held=[], ends={"FAIL": 10}, ways=1)]
    assert str(Flakiness(job="arn", name="scout in flat 2", answer="repeats", verdict="FAIL", tried=tried)) == (
        "scout in flat 2: repeats bit by bit: 10 of 10 end with FAIL\n"
        "  10 reruns as the job was; nothing else was varied, because they all ended alike.\n"
        "  A job that ends otherwise in 1 of 20 runs looks like this in 60% of such examinations: 59 reruns would be "
        "needed to see it (95% sure)."
    )
