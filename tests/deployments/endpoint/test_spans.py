"""Spans as OpenTelemetry's SDK collects them, in a process that has it: requests, runs of jobs, their steps."""

import json
import os
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest
from helpers.package_installer import install_packages

pytestmark = pytest.mark.deep

SCRIPT = """
import asyncio, json, os, sys
from pathlib import Path
from opentelemetry import trace
from opentelemetry.sdk.trace import TracerProvider
from opentelemetry.sdk.trace.export import SimpleSpanProcessor
from opentelemetry.sdk.trace.export.in_memory_span_exporter import InMemorySpanExporter
from helpers.asgi import Client
from prefect_robomaker.deployments.endpoint.application import Endpoint
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.jobs.job_runs import perform_job
from prefect_robomaker.tasks.service.service import Service

exporter = InMemorySpanExporter()
provider = TracerProvider()
provider.add_span_processor(SimpleSpanProcessor(exporter))
trace.set_tracer_provider(provider)
service = Service.open(Settings.from_environment(os.environ), {})
client = Client(Endpoint(service))
robot = {"name": "a", "robotSoftwareSuite": {"name": "General"}, "environment": {"uri": "python://json"}}
client.call("CreateRobotApplication", **robot)
config = {"application": "a", "launchConfig": {"command": ["true"]}}
trace_of_caller = {"traceparent": "00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01"}
request = {"maxJobDurationInSeconds": 60, "iamRole": "arn:aws:iam::000000000000:role/r", "robotApplications": [config]}
told = client.send("POST", "/createSimulationJob", json.dumps(request).encode(), trace_of_caller).json
perform_job(told["arn"], service)
client.close()
spans = [
    (s.name, dict(s.attributes), format(s.context.trace_id, "032x"), s.context.span_id, s.parent and s.parent.span_id)
    for s in exporter.get_finished_spans()
]
print(json.dumps({"arn": told["arn"], "spans": spans}))
"""


def test_requests_runs_and_steps_have_spans(tmp_path: Path) -> None:
    sdk, conventions = tmp_path / "sdk", tmp_path / "conventions"
    api = version("opentelemetry-api")
    install_packages(f"opentelemetry-sdk=={api}", target=sdk)
    metadata = next(sdk.glob("opentelemetry_sdk-*/METADATA")).read_text()
    needed = metadata.split("opentelemetry-semantic-conventions")[1]
    install_packages(f"opentelemetry-semantic-conventions{needed.splitlines()[0].strip()}", target=conventions)
    here = Path(__file__).parents[2]
    variables = {
        **{name: value for name, value in os.environ.items() if not name.startswith(("ROBOMAKER_", "OTEL_"))},
        "PYTHONPATH": os.pathsep.join(map(str, [sdk, conventions, here])), "ROBOMAKER_HOME": str(tmp_path / "home"),
    }  # fmt: skip

    program = [sys.executable, "-c", SCRIPT]
    done = subprocess.run(program, env=variables, capture_output=True, text=True, check=False)

    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout.splitlines()[-1])
    spans = {name: (attributes, trace, own, parent) for name, attributes, trace, own, parent in told["spans"]}
    attributes, trace, _, parent = spans["CreateSimulationJob"]
    assert attributes["robomaker.arn"] == told["arn"]
    assert attributes["http.response.status_code"] == 200
    assert (trace, parent) == ("0af7651916cd43dd8448eb211c80319c", 0xB7AD6B7169203331)
    run = spans["run simulation-job"]
    assert run[0] == {"robomaker.arn": told["arn"], "robomaker.status": "Completed"}
    steps = {name: spans[name] for name in ("prepare", "simulate", "upload")}
    assert all(step[0] == {"robomaker.arn": told["arn"]} and step[3] == run[2] for step in steps.values()), steps
