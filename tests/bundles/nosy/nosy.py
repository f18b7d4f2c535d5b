"""A job's program that calls the service as its own, and as if it were anybody: prints the status of each answer."""

import json
import os
import socket
import sys
import time
import urllib.error
import urllib.request

OWN_URL = os.environ["AWS_ENDPOINT_URL_ROBOMAKER"]
PLAIN_URL, KEY = OWN_URL.split("/of-job/")
URL = OWN_URL if os.environ["BY"] == "key" else PLAIN_URL
OWN = os.environ["AWS_ROBOMAKER_SIMULATION_JOB_ARN"]
OTHER, ORDER = json.loads(os.environ["OTHER"]), json.loads(os.environ["ORDER"])


def asked(path, members=None, **headers):
    """Status and text of an answer."""
    body = None if members is None else json.dumps(members).encode()
    request = urllib.request.Request(URL + path, data=body, headers={"content-type": "application/json", **headers})
    try:
        with urllib.request.urlopen(request, timeout=60) as answer:
            return answer.status, answer.read().decode()
    except urllib.error.HTTPError as error:
        return error.code, error.read().decode()


def in_an_orphan(path, members):
    """The same from a process whose parents have ended, in a session of its own."""
    reading, writing = os.pipe()
    if os.fork() == 0:
        os.setsid()
        if os.fork() == 0:
            time.sleep(0.2)
            os.write(writing, str(asked(path, members)[0]).encode())
        os._exit(0)
    os.close(writing)
    return int(os.read(reading, 10)), ""


def sent_and_gone(path, members):
    """A request whose sender does not wait for the answer."""
    body = json.dumps(members)
    host, port = PLAIN_URL.removeprefix("http://").split(":")
    with socket.create_connection((host, int(port))) as connection:
        head = f"POST {path} HTTP/1.1\r\nHost: {host}\r\nContent-Type: application/json\r\n"
        head += f"Content-Length: {len(body)}\r\n\r\n"
        connection.sendall((head + body).encode())
    time.sleep(0.5)
    return 0, ""


def tag_path(arn):
    return "/tags/" + arn.replace("/", "%2F")


ATTEMPTS = {
    "describe itself": lambda: asked("/describeSimulationJob", {"job": OWN}),
    "describe itself with others of its kind": lambda: asked("/batchDescribeSimulationJob", {"jobs": [OWN]}),
    "tag itself": lambda: asked(tag_path(OWN), {"tags": {"verdict": "good"}}),
    "health": lambda: asked("/health"),
    "list jobs": lambda: asked("/listSimulationJobs", {}),
    "list jobs as if a proxy passed it on": lambda: asked(
        "/listSimulationJobs", {}, **{"x-forwarded-for": "10.1.2.3", "x-forwarded-proto": "https"}
    ),
    "list batches": lambda: asked("/listSimulationJobBatches", {}),
    "list worlds": lambda: asked("/listWorlds", {}),
    "describe": lambda: asked("/describeSimulationJob", {"job": OTHER}),
    "describe both": lambda: asked("/batchDescribeSimulationJob", {"jobs": [OWN, OTHER]}),
    "tag": lambda: asked(tag_path(OTHER), {"tags": {"a": "b"}}),
    "cancel": lambda: asked("/cancelSimulationJob", {"job": OTHER}),
    "restart": lambda: asked("/restartSimulationJob", {"job": OTHER}),
    "cancel as an orphan": lambda: in_an_orphan("/cancelSimulationJob", {"job": OTHER}),
    "cancel and be gone": lambda: sent_and_gone("/cancelSimulationJob", {"job": OTHER}),
    "create with its role": lambda: asked("/createSimulationJob", ORDER),
    "create with another role": lambda: asked("/createSimulationJob", {**ORDER, "iamRole": ORDER["iamRole"] + "-b"}),
    "create with another application": lambda: asked(
        "/createSimulationJob",
        {**ORDER, "simulationApplications": [{**ORDER["simulationApplications"][0], "application": "other"}]},
    ),
    "create with data of others": lambda: asked(
        "/createSimulationJob",
        {**ORDER, "dataSources": [{"name": "a", "s3Bucket": "secrets", "s3Keys": ["b"]}]},
    ),
    "start a batch": lambda: asked("/startSimulationJobBatch", {"createSimulationJobRequests": [ORDER]}),
    "delete an application": lambda: asked("/deleteSimulationApplication", {"application": "sleeper"}),
    "metrics": lambda: asked("/metrics"),
    "console": lambda: asked("/console"),
    "console of the other": lambda: asked("/console/jobs/" + OTHER.rpartition("/")[2]),
}


def main():
    found = {}
    for name, attempt in ATTEMPTS.items():
        status, text = attempt()
        found[name] = status
        if name == "health":
            found["health says"] = sorted(json.loads(text))
    print(json.dumps(found), flush=True)
    asked("/cancelSimulationJob", {"job": OWN})
    time.sleep(600)


if __name__ == "__main__":
    sys.exit(main())
