"""What brings several machines up: compose file, Kubernetes manifests, the image, job templates of work pools."""

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from importlib.resources import files
from pathlib import Path
from typing import Any

import boto3
import jsonschema
import kubernetes_validate
import pytest
from botocore.config import Config
from botocore.exceptions import BotoCoreError, ClientError
from helpers.paths import REPOSITORY
from helpers.pool_machines import deployed_pool
from helpers.processes import started, wait_for
from helpers.real_engine import RealEngine
from helpers.s3_server import free_ports
from ruamel.yaml import YAML

from prefect_robomaker.deployments.cli.grammar import build_parser
from prefect_robomaker.deployments.deploying.job_variables import pool_template
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.simulations.containers.engines import EngineError

COMPOSE = REPOSITORY / "deployments" / "compose.yaml"
KUBERNETES = REPOSITORY / "deployments" / "kubernetes"
PAGE = REPOSITORY / "docs" / "machines.md"
VERSION = "1.37"
OURS = "prefect-robomaker"


def documents(path: Path) -> list[dict[str, Any]]:
    return [dict(each) for each in YAML(typ="safe", pure=True).load_all(path.read_text()) if each]


def manifests() -> Iterator[tuple[str, dict[str, Any]]]:
    for path in sorted(KUBERNETES.glob("*.yaml")):
        if path.name != "kustomization.yaml":
            for each in documents(path):
                yield f"{path.name}: {each['kind']} {each['metadata']['name']}", each


def containers() -> Iterator[tuple[str, dict[str, Any], dict[str, Any]]]:
    """Each container with the specification of its pod."""
    for name, manifest in manifests():
        if "template" in manifest.get("spec", {}):
            pod = manifest["spec"]["template"]["spec"]
            for container in pod["containers"]:
                yield name, pod, container


MANIFESTS = dict(manifests())
CONTAINERS = {name: (pod, container) for name, pod, container in containers()}
SERVICES: dict[str, dict[str, Any]] = documents(COMPOSE)[0]["services"]


@pytest.mark.parametrize("name", MANIFESTS)
def test_manifests_are_what_kubernetes_takes(name: str) -> None:
    kubernetes_validate.validate(MANIFESTS[name], VERSION, strict=True)


def test_a_manifest_with_a_wrong_member_is_found() -> None:
    wrong = json.loads(json.dumps(MANIFESTS["workers.yaml: Deployment workers"]))
    wrong["spec"]["template"]["spec"]["containers"][0]["livenesProbe"] = {}

    with pytest.raises(kubernetes_validate.ValidationError, match="livenesProbe"):
        kubernetes_validate.validate(wrong, VERSION, strict=True)


def test_the_kustomization_has_all_of_them() -> None:
    (found,) = documents(KUBERNETES / "kustomization.yaml")

    assert set(found["resources"]) == {path.name for path in KUBERNETES.glob("*.yaml")} - {"kustomization.yaml"}
    assert {each["name"]: each["newTag"] for each in found["images"]} == {OURS: own_version()}


@pytest.mark.parametrize("name", CONTAINERS)
def test_containers_say_what_they_need_and_how_they_are(name: str) -> None:
    pod, container = CONTAINERS[name]

    assert {"cpu", "memory"} <= container["resources"]["requests"].keys()
    assert "memory" in container["resources"]["limits"]
    assert container["image"] == OURS or re.search(r":\d", container["image"]), "an image without a version changes"
    assert pod["automountServiceAccountToken"] is False, "none speaks with the cluster"
    if container["image"] == OURS:
        assert pod["enableServiceLinks"] is False, "a service named prefect would set variables that Prefect reads"
        assert pod["securityContext"]["runAsNonRoot"] is True
    if "Job" not in name:
        assert "livenessProbe" in container
        assert {"readinessProbe", "startupProbe"} & container.keys()


def test_services_lead_to_pods_and_their_ports() -> None:
    pods = [
        (each["spec"]["template"]["metadata"]["labels"], each["spec"]["template"]["spec"]["containers"][0])
        for each in MANIFESTS.values()
        if "template" in each.get("spec", {})
    ]
    services = [each for each in MANIFESTS.values() if each["kind"] == "Service"]
    assert len(services) == 3
    for service in services:
        (container,) = [found for labels, found in pods if service["spec"]["selector"].items() <= labels.items()]
        ports = {port["containerPort"] for port in container["ports"]}
        assert {port["port"] for port in service["spec"]["ports"]} <= ports


def test_secrets_are_references_to_what_the_page_says_to_make() -> None:
    (command,) = re.findall(r"kubectl -n robomaker create secret generic robomaker (.*?)\n```", PAGE.read_text(), re.S)
    made = set(re.findall(r"--from-literal[ =]([\w-]+)=", command))

    used = set()
    for _, container in CONTAINERS.values():
        for variable in container.get("env", []):
            if reference := variable.get("valueFrom", {}).get("secretKeyRef"):
                assert reference["name"] == "robomaker"
                used.add(reference["key"])
            else:
                assert not re.search("PASSWORD|SECRET|AUTH|KEY", variable["name"]), variable
    assert used == made


def settings_of_worker(variables: dict[str, str], home: Path) -> Settings:
    return Settings.from_environment({**variables, "ROBOMAKER_HOME": str(home)})


def test_workers_share_catalog_and_store_on_both(tmp_path: Path) -> None:
    composed = SERVICES["worker"]["environment"]
    pod = {
        each["name"]: each.get("value", "postgresql+psycopg://by-reference")
        for each in CONTAINERS["workers.yaml: Deployment workers"][1]["env"]
    }
    pod |= MANIFESTS["settings.yaml: ConfigMap robomaker"]["data"]

    shared = {"ROBOMAKER_CATALOG_URL", "ROBOMAKER_OBJECT_STORE", "AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"}
    for variables in (composed, pod):
        assert shared | {"PREFECT_API_URL", "PREFECT_API_AUTH_STRING"} <= variables.keys()
        read = settings_of_worker(variables, tmp_path)
        assert read.catalog_url.startswith("postgresql+psycopg://")
        assert read.object_store == "http://objects:8333"


# Compose


def test_the_compose_file_is_what_compose_takes() -> None:
    schema = json.loads((files("check_jsonschema") / "builtin_schemas" / "vendor" / "compose-spec.json").read_text())
    found = documents(COMPOSE)[0]

    jsonschema.validate(found, schema)
    found["services"]["worker"]["comand"] = "x"
    with pytest.raises(jsonschema.ValidationError, match="comand"):
        jsonschema.validate(found, schema)


def test_docker_compose_reads_it(tmp_path: Path) -> None:
    docker = shutil.which("docker")
    if docker is None or subprocess.run([docker, "compose", "version"], capture_output=True).returncode:
        pytest.skip("docker compose is not installed")
    read = subprocess.run([docker, "compose", "-f", str(COMPOSE), "config"], capture_output=True, text=True)

    assert read.returncode == 0, read.stderr


def test_nothing_is_reached_from_other_machines_and_every_image_has_a_version() -> None:
    for name, service in SERVICES.items():
        assert all(port.startswith("127.0.0.1:") for port in service.get("ports", [])), name
        assert re.search(r":\d|\$\{ROBOMAKER_IMAGE:-prefect-robomaker:", service["image"]), name
    assert f"prefect-robomaker:{own_version()}}}" in SERVICES["worker"]["image"]


def test_both_start_the_same_servers_with_the_same_words() -> None:
    assert SERVICES["objects"]["command"] == CONTAINERS["objects.yaml: StatefulSet objects"][1]["args"]
    assert SERVICES["prefect"]["command"] == CONTAINERS["prefect.yaml: Deployment prefect"][1]["command"]
    assert SERVICES["setup"]["command"] == CONTAINERS["setup.yaml: Job setup"][1]["command"]
    for name in ("postgres", "objects"):
        assert SERVICES[name]["image"] == CONTAINERS[f"{name}.yaml: StatefulSet {name}"][1]["image"]


def test_what_setup_calls_are_commands_of_ours() -> None:
    lines = SERVICES["setup"]["command"][-1].splitlines()
    ours = [shlex.split(line)[1:] for line in lines if line.startswith("robomaker ")]

    assert ours
    for words in ours:
        build_parser().parse_args(words)


@pytest.mark.deep
def test_setup_may_run_again(prefect_server: str, settings: Settings, tmp_path: Path) -> None:
    """It makes pool and deployment in journeys/backends/test_a_laptop_becomes_two.py."""
    pool = deployed_pool(settings, prefect_server, tmp_path).name
    shell, option, script = SERVICES["setup"]["command"]
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environ = {**os.environ, "PATH": path, "PREFECT_API_URL": prefect_server, "ROBOMAKER_HOME": str(tmp_path)}
    done = subprocess.run(
        [shell, option, script.replace("machines", pool)], env=environ, capture_output=True, text=True, timeout=900
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == f"RunJobWorker/{pool}  updated"


@pytest.mark.slow
def test_the_object_store_starts_with_these_words(tmp_path: Path) -> None:
    ports = free_ports()
    words = [
        word.replace("/data", str(tmp_path)).replace("8333", str(ports["s3.port"]))
        for word in SERVICES["objects"]["command"]
    ]
    words = [word.replace("0.0.0.0", "127.0.0.1") for word in words]
    words += [f"-{name}={port}" for name, port in ports.items() if name != "s3.port"]
    keys = {"AWS_ACCESS_KEY_ID": "robomaker", "AWS_SECRET_ACCESS_KEY": "robomaker-secret", "TMPDIR": str(tmp_path)}
    weed = str(Path(sys.executable).with_name("weed"))
    with (tmp_path / "log").open("w") as log, started([weed, *words], keys, stdout=log, stderr=log, cwd=tmp_path):
        session = boto3.Session(aws_access_key_id="robomaker", aws_secret_access_key="robomaker-secret")
        client: Any = session.client(
            "s3",
            endpoint_url=f"http://127.0.0.1:{ports['s3.port']}",
            region_name="us-east-1",
            config=Config(s3={"addressing_style": "path"}, retries={"total_max_attempts": 1}, connect_timeout=2),
        )

        def put() -> bool:
            try:
                with suppress(client.exceptions.BucketAlreadyExists, client.exceptions.BucketAlreadyOwnedByYou):
                    client.create_bucket(Bucket="robomaker")
                client.put_object(Bucket="robomaker", Key="a", Body=b"b")
            except (BotoCoreError, ClientError):
                return False
            return True

        wait_for(put, "the object store")
        assert client.get_object(Bucket="robomaker", Key="a")["Body"].read() == b"b"


# The image


def test_what_the_image_is_made_of_is_there_and_not_left_out() -> None:
    lines = [
        line.split()[1:-1]
        for line in (REPOSITORY / "Dockerfile").read_text().splitlines()
        if line.startswith("COPY ") and "--from" not in line
    ]
    copied = {name for names in lines for name in names}
    let_in = {line[1:] for line in (REPOSITORY / ".dockerignore").read_text().splitlines() if line.startswith("!")}

    assert all((REPOSITORY / name).exists() for name in copied)
    assert copied == let_in


@pytest.mark.deep
@pytest.mark.timeout(1800)
def test_the_image_is_built_and_runs(real_engine: RealEngine) -> None:
    name = real_engine.note_image(f"{real_engine.prefix}/prefect-robomaker:test")
    try:
        real_engine.call("pull", "python:3.12.11-slim-bookworm")
    except EngineError as error:
        pytest.skip(f"the image's base cannot be pulled here: {error}")
    environ = {**os.environ, **real_engine.environ}
    built = subprocess.run(
        [real_engine.program, "build", "--network", "host", "-t", name, str(REPOSITORY)],
        env=environ,
        capture_output=True,
        text=True,
        timeout=1500,
    )
    assert built.returncode == 0, built.stderr[-4000:]

    assert "usage: robomaker" in real_engine.call("run", "--rm", "--network", "host", name)
    assert real_engine.call("run", "--rm", "--network", "host", name, "id", "-u").strip() == "10001"


def own_version() -> str:
    (version,) = re.findall(r'^version = "(.*)"$', (REPOSITORY / "pyproject.toml").read_text(), re.MULTILINE)
    return version


# Job templates of pools whose workers start containers


def test_a_job_of_a_kubernetes_pool_is_what_kubernetes_takes(prefect_server: str) -> None:
    from prefect.utilities.templating import apply_values

    template = pool_template("kubernetes", image="lab/robots:1", environment={"ROBOMAKER_BUCKET": "runs"})
    given = {name: each["default"] for name, each in template["variables"]["properties"].items() if "default" in each}
    job = apply_values(template["job_configuration"]["job_manifest"], {**given, "name": "job-worker"})

    # What Prefect's worker puts into it: the variables as a list, and the name of the container.
    (container,) = job["spec"]["template"]["spec"]["containers"]
    assert container["image"] == "lab/robots:1"
    container["env"] = [{"name": name, "value": value} for name, value in container["env"].items()]
    assert {"name": "ROBOMAKER_BUCKET", "value": "runs"} in container["env"]
    for misplaced in ("parallelism", "completions"):  # Prefect's own template has them one level too deep
        job["spec"]["template"]["spec"].pop(misplaced)
    kubernetes_validate.validate(job, VERSION, strict=True)


# The page that leads there


def test_the_settings_of_machines_are_those_of_the_compose_file() -> None:
    lines = (REPOSITORY / "deployments" / "machines.env").read_text().splitlines()
    given = dict(line.split("=", 1) for line in lines if line and not line.startswith("#"))

    inside = {
        name: re.sub(r"\$\{\w+:-(.*?)\}", r"\1", value) for name, value in SERVICES["worker"]["environment"].items()
    }
    assert given == {
        name: re.sub("(?<=[@/])(postgres|objects|prefect)(?=:)", "127.0.0.1", value) for name, value in inside.items()
    }


def test_the_page_forwards_the_ports_that_are_open_and_its_commands_are_ours() -> None:
    text = PAGE.read_text()
    forwarded = set(re.findall(r"-R (\d+):127\.0\.0\.1:(\d+)", text))

    opened = {port.split(":")[1] for service in SERVICES.values() for port in service.get("ports", [])}
    assert forwarded == {(port, port) for port in opened}
    commands = re.findall(r"^\$ (?:\w+=\S+ )*robomaker (.*)$", text, re.MULTILINE)
    assert len(commands) >= 4
    for words in commands:
        build_parser().parse_args(shlex.split(words.partition(" > ")[0]))
    assert len(re.findall(r"^\$ ", text.split("five commands")[1].split("```")[1], re.MULTILINE)) == 5
