"""What has to be true of a batch on PostgreSQL and S3 whatever happened meanwhile, seen without our own code."""

import json
import re
from typing import Any, LiteralString

import psycopg

from helpers.processes import wait_for

_KILLED = r"3 job workers died, one after the other|each of 3 attempts was killed"

_HELD = """
    SELECT id FROM resources
    WHERE (arn = %s OR parent = %s) AND lease_owner IS NOT NULL
    AND lease_expires_at > extract(epoch FROM now()) * 1000000
"""


def rows(url: str, query: LiteralString, *values: str) -> list[Any]:
    """Rows of the catalog's database, read without our code; it may be starting again."""
    with psycopg.connect(url.replace("postgresql+psycopg", "postgresql"), connect_timeout=5) as connection:
        return connection.execute(query, values).fetchall()


def has_ended(url: str, batch: str) -> bool:
    try:
        [[status]] = rows(url, "SELECT status FROM resources WHERE arn = %s", batch)
    except psycopg.OperationalError:
        return False
    return status in ("Completed", "Failed", "Canceled", "TimedOut")


def check_invariants(url: str, batch: str, jobs: int, s3: Any, bucket: str, most_failed: int) -> None:
    """Looks from outside at what is left of a batch that was killed at all ends.

    Chance may kill one job three times in a row before it comes further, and such a job fails with these words: at most
    `most_failed` may.
    """
    # A job worker that is killed between the end of its job and giving back the lease leaves one that runs out.
    wait_for(lambda: not rows(url, _HELD, batch, batch), "leases to be given back or to run out")
    [[status, document]] = rows(url, "SELECT status, document FROM resources WHERE arn = %s", batch)
    assert status == "Completed", {name: document.get(name) for name in ("failureCode", "failureReason", "failed")}
    query = "SELECT id, status, document FROM resources WHERE parent = %s AND kind = 'simulation-job'"
    made = rows(url, query, batch)
    assert sorted(job["requestIndex"] for _, _, job in made) == list(range(jobs)), "each request, once"
    failed = [document["failureReason"] for _, status, document in made if status == "Failed"]
    assert all(re.match(_KILLED, reason) for reason in failed), failed
    assert len(failed) <= most_failed, "each of these was killed three times"
    whole = [(job, document) for job, status, document in made if status != "Failed"]
    ends = {(status, document.get("verdict")) for _, status, document in made if status != "Failed"}
    assert ends == {("Completed", "PASS")}
    digests = set()
    for job, document in whole:
        prefix = document["outputs"]["prefix"]
        manifest = json.load(s3.get_object(Bucket=bucket, Key=f"{prefix}/manifest.json")["Body"])
        for file in manifest["files"]:
            head = s3.head_object(Bucket=bucket, Key=f"{prefix}/{file['path']}")
            assert head["ContentLength"] == file["size_bytes"], f"{job}: {file['path']} is half-written"
        digests.add(json.load(s3.get_object(Bucket=bucket, Key=f"{prefix}/result.json")["Body"])["state_digest"])
    assert len(digests) == 1, "equal jobs end in the same state, whatever was killed meanwhile"
