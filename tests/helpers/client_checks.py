"""What each client has to have been told, whichever language it is written in."""

import json
import time
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

Told = Mapping[str, Any]

_OLDEST_S = 3000.0
"""Longer than tests take, and shorter than an hour, by which time zones differ."""
ERRORS = {
    "missing": ("ResourceNotFoundException", "there is no resource"),
    "missingTags": ("ResourceNotFoundException", "there is no resource"),
    "invalidBody": ("InvalidParameterException", "Buildings: 4: a list would be right"),
    "tooLarge": ("InvalidParameterException", "maxResults: is 101; it may be at most 100"),
    "notInEnum": ("InvalidParameterException", "versionQualifier: is 'SOME'"),
    "notPattern": ("InvalidParameterException", "nextToken: is 'no such page!'"),
    "foreignToken": ("InvalidParameterException", "it has to come from the page before"),
    "exists": ("ResourceAlreadyExistsException", "already has the name"),
    "mismatch": ("IdempotentParameterMismatchException", "was used for"),
    "limit": ("LimitExceededException", "40 of at most 40"),
}
"""What clients are refused, step by step: the error's class, and words of its message."""


def check_worlds(told: Told, wanted: Mapping[str, Any], objects: Path) -> None:
    """A template, two worlds of it, an export, their lists, and their end."""
    template = told["template"]["arn"]
    job = told["generation"]["arn"]
    worlds = told["generated"]["finishedWorldsSummary"]["succeededWorlds"]
    assert told["template"]["tags"] == told["templateDescribed"]["tags"] == {"team": "maps"}
    assert told["templateDescribed"]["name"] == wanted["name"]
    assert json.loads(told["body"]["templateBody"]) == json.loads(wanted["body"])
    assert told["generation"]["status"] == "Pending"
    assert told["generated"]["status"] == "Completed", told["generated"]
    assert told["generated"]["tags"] == {"why": "nightly"}
    assert worlds == [f"{job.replace('-generation-job', '')}/world-{number}" for number in (1, 2)]
    assert sorted(_arns(told["worlds"])) == worlds
    assert {(each["generationJob"], each["template"]) for each in told["worlds"]} == {(job, template)}
    assert told["world"]["arn"] == worlds[0]
    assert told["world"]["tags"] == {"made by": "clients"}
    assert _arns(told["generations"]) == [job]
    assert template in _arns(told["templates"])
    _check_export(told, worlds[0], objects)
    assert told["worldsDeleted"] == {"unprocessedWorlds": [f"{worlds[0]}0"]}
    assert _arns(told["worldsLeft"]) == worlds[1:]
    assert told["templateGone"]["code"] == "ResourceNotFoundException"
    _check_times(told, at_least=10)


def _check_export(told: Told, world: str, objects: Path) -> None:
    exported = told["exported"]
    assert (exported["status"], exported["worlds"]) == ("Completed", [world])
    assert exported["arn"] in _arns(told["exports"])
    place = exported["outputLocation"]
    short_id = exported["arn"].partition("/export-")[2]
    name = f"aws-robomaker-worldforge-export-{short_id}.zip"
    with zipfile.ZipFile(objects / place["s3Bucket"] / place["s3Prefix"] / name) as archive:
        assert any(each.endswith("world.xml") for each in archive.namelist())


def check_simulations(told: Told, wanted: Mapping[str, Any], objects: Path) -> None:
    """A job with its outputs and tags, and a batch of which one request is wrong."""
    assert [told[f"{kind}Application"]["version"] for kind in ("robot", "simulation")] == ["$LATEST"] * 2
    ended = told["jobEnded"]
    assert (ended["status"], ended["tags"]) == ("Completed", {"run": "1"})
    assert "failureCode" not in ended
    assert ended["robotApplications"][0]["launchConfig"]["launchFile"] == "make_agent"
    place = ended["outputLocation"]
    assert place == {"s3Bucket": wanted["bucket"], "s3Prefix": f"runs/{wanted['name']}"}
    (run,) = (objects / place["s3Bucket"] / place["s3Prefix"] / ended["name"]).iterdir()
    assert f"agent watches {ended['name']}" in (run / "logs" / "stdout.log").read_text()
    assert told["tags"] == {"tags": {"run": "2", "verdict": "pass", "seen by": "me/you:+="}}
    assert told["tagsLeft"] == {"tags": {"run": "2", "verdict": "pass"}}

    batch = told["batchEnded"]
    assert (batch["status"], batch["tags"], batch["pendingRequests"]) == ("Completed", {"night": "monday"}, [])
    jobs = _arns(batch["createdRequests"])
    assert [each["status"] for each in batch["createdRequests"]] == ["Completed"] * 2
    (failed,) = batch["failedRequests"]
    assert (failed["failureCode"], failed["request"]["iamRole"]) == ("ResourceNotFound", wanted["role"])
    assert _arns(told["jobsDescribed"]["jobs"]) == jobs
    assert told["jobsDescribed"]["unprocessedJobs"] == [f"{ended['arn']}0"]
    assert sorted(_arns(told["jobs"])) == sorted([ended["arn"], *jobs])
    assert _arns(told["jobs"])[-1] == ended["arn"], "the newest is listed first"
    assert told["jobs"][-1]["lastUpdatedAt"] == ended["lastUpdatedAt"], "neither tags nor the end of its run change it"
    (summary,) = [each for each in told["batches"] if each["arn"] == batch["arn"]]
    assert [summary[f"{kind}RequestCount"] for kind in ("created", "failed", "pending")] == [2, 1, 0]
    _check_times(told, at_least=15)


def check_pages(told: Told, *lists: str) -> None:
    """The SDK's paginator asked for pages of one entry, and got them."""
    assert [told[f"{each}Most"] for each in lists] == [1] * len(lists)


def check_cancels(told: Told) -> None:
    """A job cancelled while it runs, and a batch before or while its jobs run."""
    assert told["jobRunning"]["status"] == "Running"
    assert told["jobRunning"]["networkInterface"]["privateIpAddress"]
    assert (told["jobCancelled"]["status"], told["batchEnded"]["status"]) == ("Canceled", "Canceled")
    assert {each["failureCode"] for each in told["batchEnded"]["failedRequests"]} <= {"BatchCanceled"}
    assert {each["status"] for each in told["batchEnded"]["createdRequests"]} <= {"Canceled"}
    started = told["jobRunning"]["lastStartedAt"]["time"]
    assert told["job"]["lastUpdatedAt"]["time"] <= started <= told["jobCancelled"]["lastUpdatedAt"]["time"]


def check_errors(told: Told) -> None:
    """Each refusal has the class that programs catch, says what is wrong, and is not tried again."""
    for step, (name, message) in ERRORS.items():
        # Newer SDKs try again by themselves when they see this one, whichever service it comes from.
        check_refusal(told[step], name, message, tried_again=step == "limit")
    requests = [told[step]["requestId"] for step in ERRORS]
    assert len(set(requests)) == len(requests)
    assert told["again"]["arn"] == told["first"]["arn"]
    assert told["versions"] == [str(number) for number in range(1, 41)]


def check_refusal(refusal: Mapping[str, Any], name: str, message: str, *, tried_again: bool = False) -> None:
    """A client knew the class of an error, and did not try again unless that is said."""
    expected = {"code": name, "class": name, "status": 400}
    assert {key: refusal[key] for key in expected} == expected
    assert refusal["attempts"] == 1 or tried_again
    assert message in refusal["message"]


def _arns(entries: list[Mapping[str, Any]]) -> list[str]:
    return [each["arn"] for each in entries]


def _check_times(told: Told, at_least: int) -> None:
    """Every moment is of this test run: seconds were not taken for milliseconds, nor zones mixed up."""
    members = list(_members(told))
    moments = [value for key, value in members if isinstance(value, dict) and list(value) == ["time"]]
    named = [key for key, value in members if key.endswith("At")]
    assert len(moments) == len(named) >= at_least
    mine = [value["time"] for value in moments]
    assert time.time() - _OLDEST_S < min(mine) <= max(mine) <= time.time() + 1


def _members(value: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict):
        for key, each in value.items():
            yield key, each
            yield from _members(each)
    elif isinstance(value, list):
        for each in value:
            yield from _members(each)
