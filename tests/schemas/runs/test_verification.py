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
