"""Somebody's program: boto3 against the service. Run by itself, with nothing of ours; prints what it was told.

`boto3_client.py PART`, with what to ask for as JSON on standard input. It runs with the boto3 that still has the
service, and with today's, which knows it from our model.
"""

import json
import sys
import time
from datetime import datetime

import boto3
from botocore.exceptions import ClientError

robomaker = boto3.client("robomaker")
wanted = json.load(sys.stdin)
name = wanted["name"]
waited = []
told = {"boto3": boto3.__version__, "waiters": robomaker.waiter_names, "waited": waited}


def worlds():
    template = tell("template", "create_world_template", name=name, templateBody=wanted["body"], tags={"team": "maps"})
    template_arn = template["arn"]
    tell("templateDescribed", "describe_world_template", template=template_arn)
    tell("body", "get_world_template_body", template=template_arn)
    job = tell(
        "generation",
        "create_world_generation_job",
        template=template_arn,
        worldCount={"floorplanCount": 1, "interiorCountPerFloorplan": 2},
        tags={"why": "nightly"},
        worldTags={"made by": "clients"},
    )
    generated = finish("generated", "describe_world_generation_job", "WorldGenerationJobCompleted", job=job["arn"])
    one_job = [{"name": "generationJobId", "values": [short_id(job["arn"])]}]
    pages("worlds", "list_worlds", "worldSummaries", filters=one_job)
    if generated["status"] != "Completed":
        raise SystemExit(generated)
    first, *_ = generated["finishedWorldsSummary"]["succeededWorlds"]
    tell("world", "describe_world", world=first)
    export = tell(
        "export",
        "create_world_export_job",
        worlds=[first],
        outputLocation={"s3Bucket": wanted["bucket"], "s3Prefix": f"exports/{name}"},
        iamRole=wanted["role"],
    )
    finish("exported", "describe_world_export_job", "WorldExportJobCompleted", job=export["arn"])
    pages("exports", "list_world_export_jobs", "worldExportJobSummaries")
    of_template = [{"name": "templateId", "values": [short_id(template_arn)]}]
    pages("generations", "list_world_generation_jobs", "worldGenerationJobSummaries", filters=of_template)
    pages("templates", "list_world_templates", "templateSummaries")
    tell("worldsDeleted", "batch_delete_worlds", worlds=[first, f"{first}0"])
    pages("worldsLeft", "list_worlds", "worldSummaries", filters=one_job)
    tell("templateDeleted", "delete_world_template", template=template_arn)
    refuse("templateGone", "describe_world_template", template=template_arn)


def simulations():
    applications = create_applications()
    output = {"s3Bucket": wanted["bucket"], "s3Prefix": f"runs/{name}"}
    request = job_request(applications, tags={"run": "1"}, outputLocation=output)
    arn = tell("job", "create_simulation_job", **request)["arn"]
    finish("jobEnded", "describe_simulation_job", "SimulationJobCompleted", job=arn)
    tell("tagged", "tag_resource", resourceArn=arn, tags={"verdict": "pass", "seen by": "me/you:+=", "run": "2"})
    tell("tags", "list_tags_for_resource", resourceArn=arn)
    tell("untagged", "untag_resource", resourceArn=arn, tagKeys=["seen by", "never there"])
    tell("tagsLeft", "list_tags_for_resource", resourceArn=arn)

    good = {key: value for key, value in job_request(applications).items() if key != "clientRequestToken"}
    wrong = json.loads(json.dumps(good))
    wrong["robotApplications"][0]["application"] += "0"
    batch = tell(
        "batch",
        "start_simulation_job_batch",
        createSimulationJobRequests=[good, wrong, good],
        batchPolicy={"maxConcurrency": 2, "timeoutInSeconds": 300},
        tags={"night": "monday"},
    )
    ended = finish(
        "batchEnded",
        "describe_simulation_job_batch",
        "SimulationJobBatchCompleted",
        busy=BATCH_BUSY,
        batch=batch["arn"],
    )
    jobs = [each["arn"] for each in ended["createdRequests"]]
    tell("jobsDescribed", "batch_describe_simulation_job", jobs=[*jobs, f"{arn}0"])
    mine = [{"name": "simulationApplicationName", "values": [name]}]
    pages("jobs", "list_simulation_jobs", "simulationJobSummaries", filters=mine)
    pages("batches", "list_simulation_job_batches", "simulationJobBatchSummaries")


def cancels():
    long = job_request(create_applications(), {"DURATION_S": "250"})
    arn = tell("job", "create_simulation_job", **long)["arn"]
    waiter = "SimulationJobRunning"
    tell("jobRunning", "describe_simulation_job", job=until_status(waiter, "describe_simulation_job", job=arn)["arn"])
    tell("cancelled", "cancel_simulation_job", job=arn)
    finish("jobCancelled", "describe_simulation_job", job=arn)
    batch = tell("batch", "start_simulation_job_batch", createSimulationJobRequests=[long, long])["arn"]
    tell("batchCancelled", "cancel_simulation_job_batch", batch=batch)
    finish("batchEnded", "describe_simulation_job_batch", busy=BATCH_BUSY, batch=batch)


def errors():
    nobody = "arn:aws:robomaker:us-east-1:000000000000:simulation-job/sim-000000000000"
    refuse("missing", "describe_simulation_job", job=nobody)
    refuse("missingTags", "tag_resource", resourceArn=nobody, tags={"a": "b"})
    refuse("invalidBody", "create_world_template", name=name, templateBody='{"Buildings": 4}')
    refuse("tooLarge", "list_worlds", maxResults=101)
    refuse("notInEnum", "list_robot_applications", versionQualifier="SOME")
    refuse("notPattern", "list_worlds", nextToken="no such page!")
    refuse("foreignToken", "list_worlds", nextToken="bm93aGVyZQ==")
    applications = create_applications()
    robot = {"name": name, "robotSoftwareSuite": {"name": "General"}, "sources": wanted["sources"]}
    refuse("exists", "create_robot_application", **robot)
    request = {**job_request(applications), "clientRequestToken": name}
    first = tell("first", "create_simulation_job", **request)
    tell("again", "create_simulation_job", **request)
    refuse("mismatch", "create_simulation_job", **{**request, "maxJobDurationInSeconds": 61})
    tell("cancelled", "cancel_simulation_job", job=first["arn"])
    versions = [
        robomaker.create_robot_application_version(application=applications["robot"])["version"] for _ in range(40)
    ]
    told["versions"] = versions
    refuse("limit", "create_robot_application_version", application=applications["robot"])


BUSY = ("Pending", "Preparing", "Running", "Restarting", "Terminating", "Canceling")
BATCH_BUSY = ("Pending", "InProgress", "Completing", "Canceling", "TimingOut")


def create_applications():
    common = {"name": name, "robotSoftwareSuite": {"name": "General"}, "sources": wanted["sources"]}
    robot = tell("robotApplication", "create_robot_application", **common)
    suite = {"name": "SimulationRuntime"}
    simulation = tell("simulationApplication", "create_simulation_application", **common, simulationSoftwareSuite=suite)
    return {"robot": robot["arn"], "simulation": simulation["arn"]}


def job_request(applications, variables=None, **members):
    def use(kind, launch, **more):
        launch = {"packageName": wanted["package"], "launchFile": launch, **more}
        return [{"application": applications[kind], "launchConfig": launch}]

    more = {"environmentVariables": variables} if variables else {}
    return {
        "maxJobDurationInSeconds": 60,
        "iamRole": wanted["role"],
        "robotApplications": use("robot", "make_agent"),
        "simulationApplications": use("simulation", "make_environment", **more),
        **members,
    }


def tell(step, method, **members):
    answer = getattr(robomaker, method)(**members)
    answer.pop("ResponseMetadata")
    told[step] = answer
    return answer


def finish(step, method, waiter="", busy=BUSY, **members):
    """Waits as well as this boto3 can."""
    if snake(waiter) in robomaker.waiter_names:
        robomaker.get_waiter(snake(waiter)).wait(**members, WaiterConfig={"Delay": 1, "MaxAttempts": 240})
        waited.append(waiter)
    else:
        until(lambda: getattr(robomaker, method)(**members)["status"] not in busy)
    return tell(step, method, **members)


def until_status(waiter, method, **members):
    if snake(waiter) in robomaker.waiter_names:
        robomaker.get_waiter(snake(waiter)).wait(**members, WaiterConfig={"Delay": 1, "MaxAttempts": 240})
        waited.append(waiter)
    until(lambda: getattr(robomaker, method)(**members)["status"] == "Running")
    return getattr(robomaker, method)(**members)


def until(done):
    end = time.monotonic() + 240
    while not done():
        if time.monotonic() > end:
            raise SystemExit("waited too long")
        time.sleep(0.2)


def pages(step, method, key, **members):
    """All pages of one entry each, by the SDK's own paginator."""
    found = [
        page[key] for page in robomaker.get_paginator(method).paginate(**members, PaginationConfig={"PageSize": 1})
    ]
    told[step] = [entry for page in found for entry in page]
    told[f"{step}Most"] = max(map(len, found))


def refuse(step, method, **members):
    try:
        getattr(robomaker, method)(**members)
    except ClientError as error:
        known = isinstance(error, getattr(robomaker.exceptions, error.response["Error"]["Code"]))
        metadata = error.response["ResponseMetadata"]
        told[step] = {
            "code": error.response["Error"]["Code"],
            "class": type(error).__name__ if known else None,
            "message": error.response["Error"]["Message"],
            "status": metadata["HTTPStatusCode"],
            "requestId": metadata["RequestId"],
            "attempts": 1 + metadata["RetryAttempts"],
        }
    else:
        told[step] = "was not refused"


def short_id(arn):
    return arn.rpartition("/")[2]


def snake(words):
    return "".join(f"_{letter.lower()}" if letter.isupper() else letter for letter in words).lstrip("_")


def as_json(value):
    assert isinstance(value, datetime)
    assert value.tzinfo is not None
    return {"time": value.timestamp()}


{part.__name__: part for part in (worlds, simulations, cancels, errors)}[sys.argv[1]]()
json.dump(told, sys.stdout, default=as_json)
