"""Ways in which programs really used the service, seen in public; each function is one, named after what it relies on.

`habits_client.py HABIT...`, with what to ask for as JSON on standard input, and the boto3 that still has the service;
prints what each habit found, or how it failed. Members are looked up without a guard where those programs did so.
"""

import json
import sys
import time
import traceback

import boto3
from botocore.exceptions import ClientError

robomaker = boto3.client("robomaker")
wanted = json.load(sys.stdin)
name, bucket, role = wanted["name"], wanted["bucket"], wanted["role"]
GENERAL = {"name": "General"}


def export_is_found_by_the_id_in_its_jobs_arn():
    template = robomaker.create_world_template(name=name, templateBody=json.dumps(json.loads(wanted["body"])))["arn"]
    count = {"floorplanCount": 1, "interiorCountPerFloorplan": 1}
    generation = robomaker.create_world_generation_job(template=template, worldCount=count)["arn"]
    poll(lambda: robomaker.describe_world_generation_job(job=generation)["status"] == "Completed")
    # One page of all worlds, searched here.
    mine = [each for each in robomaker.list_worlds()["worldSummaries"] if each["generationJob"] == generation]
    place = {"s3Bucket": bucket, "s3Prefix": generation}
    export = robomaker.create_world_export_job(worlds=[mine[0]["arn"]], outputLocation=place, iamRole=role)["arn"]
    poll(lambda: robomaker.describe_world_export_job(job=export)["status"] == "Completed")
    key = f"{generation}/aws-robomaker-worldforge-export-{export.split('/export-')[1]}.zip"

    applications = created_unless_listed()
    source = {"name": "world", "s3Bucket": bucket, "s3Keys": [key], "type": "Archive"}
    launch = {"packageName": "sleeper", "streamUI": False, "portForwardingConfig": {"portMappings": []}}
    job = robomaker.create_simulation_job(
        iamRole=role,
        maxJobDurationInSeconds=300,
        outputLocation={},
        dataSources=[source],
        robotApplications=[
            {"application": applications[0], "launchConfig": {**launch, "launchFile": "make_agent"}, "tools": []}
        ],
        simulationApplications=[
            {
                "application": applications[1],
                "launchConfig": {**launch, "launchFile": "make_environment"},
                "worldConfigs": [],
                "tools": [],
            }
        ],
    )
    assert "outputLocation" not in job
    poll(lambda: robomaker.describe_simulation_job(job=job["arn"])["status"] == "Completed")
    sources = robomaker.describe_simulation_job(job=job["arn"])["dataSources"]
    return {"key": key, "worlds": len(mine), "etag": sources[0]["s3Keys"][0]["etag"]}


def created_unless_listed():
    """Asks for the one application of a name, and makes it when the list is empty."""
    arns = []
    for kind, more in (("robot", {}), ("simulation", {"simulationSoftwareSuite": {"name": "SimulationRuntime"}})):
        filters = [{"name": "name", "values": [name]}]
        found = getattr(robomaker, f"list_{kind}_applications")(filters=filters, maxResults=1)
        assert found[f"{kind}ApplicationSummaries"] == []
        create = getattr(robomaker, f"create_{kind}_application")
        create(name=name, sources=wanted["sources"], robotSoftwareSuite=GENERAL, **more)
        found = getattr(robomaker, f"list_{kind}_applications")(filters=filters, maxResults=1)
        arns.append(found[f"{kind}ApplicationSummaries"][0]["arn"])
    return arns


def output_is_read_where_the_job_says_it_is():
    place = {"s3Bucket": bucket, "s3Prefix": f"runs/{name}"}
    arn = robomaker.create_simulation_job(**order(), outputLocation=place, failureBehavior="Fail")["arn"]
    poll(lambda: robomaker.describe_simulation_job(job=arn)["status"] in ("Completed", "Failed"))
    job = robomaker.describe_simulation_job(job=arn)
    if "failureCode" in job:
        return job["failureCode"]
    launched = job["simulationApplications"][0]["launchConfig"]["launchFile"]
    return {"place": f"{job['outputLocation']['s3Bucket']}/{job['outputLocation']['s3Prefix']}", "launched": launched}


def failure_is_told_by_its_code_being_there():
    request = order(FAIL_AT_STEP="1")
    arn = robomaker.create_simulation_job(**request, failureBehavior="Fail")["arn"]
    early, finished = [], ("Completed", "Failed", "RunningFailed", "Terminating", "Terminated", "Canceled")
    poll(lambda: early.append(robomaker.describe_simulation_job(job=arn)) or early[-1]["status"] in finished)
    assert "failureCode" not in early[0]
    return {"code": early[-1]["failureCode"], "reason": early[-1]["failureReason"]}


def tags_and_lists_of_batches_are_indexed():
    good = order()
    wrong = order()  # the demo has the simulation's ARN where the robot's belongs
    wrong["robotApplications"][0]["application"] = good["simulationApplications"][0]["application"]
    policy = {"timeoutInSeconds": 50, "maxConcurrency": 2}  # less than a job may take
    batch = robomaker.start_simulation_job_batch(batchPolicy=policy, createSimulationJobRequests=[good, wrong])
    counted = [len(batch[f"{kind}Requests"]) for kind in ("created", "pending", "failed")]
    poll(lambda: robomaker.describe_simulation_job_batch(batch=batch["arn"])["status"] == "Completed")
    batch = robomaker.describe_simulation_job_batch(batch=batch["arn"])
    jobs = robomaker.batch_describe_simulation_job(jobs=[each["arn"] for each in batch["createdRequests"]])["jobs"]
    return {
        "atFirst": sum(counted),
        "atLast": [len(batch[f"{kind}Requests"]) for kind in ("created", "pending", "failed")],
        "failed": batch["failedRequests"][0]["failureCode"],
        "tags": [list(job["tags"].keys()) for job in jobs],
    }


def names_stand_where_arns_belong():
    bare = [{key: value for key, value in source.items() if key != "architecture"} for source in wanted["sources"]]
    made = robomaker.create_robot_application(name=name, sources=bare, robotSoftwareSuite=GENERAL)
    found = robomaker.describe_robot_application(application=name)
    names = [each["name"] for each in robomaker.list_robot_applications()["robotApplicationSummaries"]]
    robomaker.delete_robot_application(application=name)
    left = [each["name"] for each in robomaker.list_robot_applications()["robotApplicationSummaries"]]
    source = {key: value for key, value in found["sources"][0].items() if key != "etag"}
    listed = [name in names, name in left]
    return {"same": found["arn"] == made["arn"], "asGiven": source == bare[0], "listed": listed}


def running_jobs_have_an_address():
    subnets = {"subnets": ["subnet-1", "subnet-1"], "securityGroups": ["sg-1"], "assignPublicIp": True}
    arn = robomaker.create_simulation_job(**order(DURATION_S="200"), vpcConfig=subnets)["arn"]
    poll(lambda: robomaker.describe_simulation_job(job=arn)["status"] == "Running")
    address = robomaker.describe_simulation_job(job=arn)["networkInterface"]
    robomaker.cancel_simulation_job(job=arn)
    return [address["privateIpAddress"], address["publicIpAddress"]]


def what_is_deleted_cannot_be_described():
    suite = {"simulationSoftwareSuite": {"name": "SimulationRuntime"}, "robotSoftwareSuite": GENERAL}
    arn = robomaker.create_simulation_application(name=name, sources=wanted["sources"], **suite)["arn"]
    assert robomaker.describe_simulation_application(application=arn)["name"] == name
    robomaker.delete_simulation_application(application=arn)
    robomaker.delete_simulation_application(application=arn)  # again, as clean-up scripts do
    try:
        robomaker.describe_simulation_application(application=arn)
    except ClientError as error:
        return error.response["Error"]["Code"]
    return None


def existing_applications_are_updated():
    given = {"sources": wanted["sources"], "robotSoftwareSuite": GENERAL}
    revisions = []
    for _ in range(2):
        try:
            made = robomaker.create_robot_application(name=name, **given)
        except robomaker.exceptions.ResourceAlreadyExistsException:
            filters = [{"name": "name", "values": [name]}]
            arn = robomaker.list_robot_applications(filters=filters)["robotApplicationSummaries"][0]["arn"]
            now = robomaker.describe_robot_application(application=arn)["revisionId"]
            made = robomaker.update_robot_application(application=arn, currentRevisionId=now, **given)
        revisions.append(made["revisionId"])
    version = robomaker.create_robot_application_version(application=made["arn"], currentRevisionId=revisions[-1])
    return {"revisions": len(set(revisions)), "version": version["version"]}


def tokens_are_made_of_the_second():
    request = {**order(), "clientRequestToken": time.strftime("%Y-%m-%d-%H-%M-%S") + name}
    return len({robomaker.create_simulation_job(**request)["arn"] for _ in range(3)})


def template_bodies_are_wrapped():
    body = json.dumps({"name": "inner", "templateBody": json.loads(wanted["body"])})
    arn = robomaker.create_world_template(name=name, templateBody=body)["arn"]
    count = {"floorplanCount": 1, "interiorCountPerFloorplan": 1}
    job = robomaker.create_world_generation_job(template=arn, worldCount=count)["arn"]
    ends = ("Completed", "Failed", "PartialFailed")
    poll(lambda: robomaker.describe_world_generation_job(job=job)["status"] in ends)
    ended = robomaker.describe_world_generation_job(job=job)
    return [ended["status"], ended.get("failureReason")]


def order(**variables):
    robot, simulation = ARNS[:] = ARNS or created_unless_listed()
    launch = {"packageName": wanted["package"], "launchFile": "make_environment"}
    if variables:
        launch["environmentVariables"] = variables
    watch = {"packageName": wanted["package"], "launchFile": "make_agent"}
    return {
        "iamRole": role,
        "maxJobDurationInSeconds": 300,
        "robotApplications": [{"application": robot, "launchConfig": watch}],
        "simulationApplications": [{"application": simulation, "launchConfig": launch}],
    }


ARNS = []


def poll(done):
    end = time.monotonic() + 240
    while not done():
        if time.monotonic() > end:
            raise TimeoutError("waited too long")
        time.sleep(0.2)


told = {}
for habit in sys.argv[1:]:
    name = f"{wanted['name']}-{habit.replace('_', '-')[:30]}"
    ARNS.clear()
    try:
        told[habit] = {"found": globals()[habit]()}
    except Exception:
        told[habit] = {"failed": traceback.format_exc()}
print(json.dumps(told))
