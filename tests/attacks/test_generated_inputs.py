"""Inputs of every surface, generated from a seed: each is taken or refused in words, in one CPU-second at most.

CI takes a sample. The full run is of 100,000 inputs, with a seed of one's choice:

    ROBOMAKER_TESTS_SEED=7 pytest -n 0 -m endurance tests/attacks/test_generated_inputs.py -s
"""

import copy
import gzip
import io
import json
import os
import random
import resource
import shutil
import tarfile
import time
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
import yaml
from ezdxf import filemanagement
from helpers.asgi import Client
from helpers.colcon_bundles import bundle_v1
from helpers.paths import REPOSITORY
from helpers.small_flat import BODY, ROLE

from prefect_robomaker.deployments.endpoint.application import Endpoint
from prefect_robomaker.schemas.specs.check import load_spec
from prefect_robomaker.schemas.templates.drawing_notes import DrawingNotes
from prefect_robomaker.schemas.wire.errors import RobomakerError
from prefect_robomaker.tasks.operations.registry import call, registry
from prefect_robomaker.tasks.runtime.agents.agent_client import FrameBuffer, ProtocolError, json_message
from prefect_robomaker.tasks.runtime.robots.robot_yaml.model import load_model
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.simulations.inputs.bundles import unpack_colcon_bundle
from prefect_robomaker.tasks.simulations.ros.job_services import answer
from prefect_robomaker.tasks.storage import unpack
from prefect_robomaker.tasks.worldforge.drawings.drawing_import import planned

Surface = Callable[[random.Random], object]
"""Generates one input and has it taken or refused."""

SPECS = REPOSITORY / "deployments" / "specs"
MOST_CPU_S = 1.0
MOST_GROWTH_KB = 500_000
"""Growth of the process that is allowed over all inputs; most of it is modules that are imported on the way."""
MOST_REPEATED = 4_000
"""Characters: what is longer is not repeated, so that inputs stay below the limit of a request."""
ARN = "arn:aws:robomaker:us-east-1:000000000000"
SPEC = f"""version: 1
name: night
steps:
  template: {{operation: CreateWorldTemplate, input: {{name: flat, templateBody: {json.dumps(BODY)}}}}}
  worlds: {{operation: CreateWorldGenerationJob, input: {{template: "${{{{ template.arn }}}}", seed: 7}}}}
  drive:
    operation: StartSimulationJobBatch
    input:
      createSimulationJobRequests:
        forEach: "${{{{ worlds.finishedWorldsSummary.succeededWorlds }}}}"
        as: world
        value: {{maxJobDurationInSeconds: 60, iamRole: "{ROLE}"}}
"""
JOB = {
    "maxJobDurationInSeconds": 60, "iamRole": ROLE, "tags": {"a": "b"}, "clientRequestToken": "t",
    "robotApplications": [{"application": "scout", "launchConfig": {"environmentVariables": {"A": "b"}}}],
    "dataSources": [{"name": "m", "s3Bucket": "robomaker", "s3Keys": ["k"]}], "loggingConfig": {},
}  # fmt: skip
TEXTS = [
    "",
    " ",
    "\0",
    "ü" * 300,
    "../..",
    "a/../b",
    "-1",
    "1e999",
    "${{ a.b }}",
    "*" * 2000,
    "\ud800",
    "x" * 70_000,
    ARN,
]
VALUES = [None, True, 0, -1, 2**63, 2**200, 1e308, 0.1, [], {}, [[]], {"": None}, *TEXTS]


def wild(rng: random.Random, depth: int = 3) -> Any:
    """Any value of JSON."""
    kind = rng.randrange(8) if depth else 0
    if kind == 1:
        return [wild(rng, depth - 1) for _ in range(rng.choice([1, 3, 60]))]
    if kind == 2:
        return {rng.choice(["name", "arn", "tags", *TEXTS[:8]]): wild(rng, depth - 1) for _ in range(rng.randrange(5))}
    return copy.deepcopy(rng.choice(VALUES))


def spoilt(value: Any, rng: random.Random) -> Any:
    """A value with one of its parts replaced, removed, renamed or repeated."""
    if isinstance(value, dict) and value and rng.random() < 0.8:
        key = rng.choice(sorted(value))
        other = {name: part for name, part in value.items() if name != key or rng.random() < 0.9}
        other[key if rng.random() < 0.85 else rng.choice(TEXTS)] = spoilt(value[key], rng)
        return other
    if isinstance(value, list) and value and rng.random() < 0.8:
        place = rng.randrange(len(value))
        others = [*value[:place], spoilt(value[place], rng), *value[place:]]
        return others * rng.choice([1, 1, 40]) if len(json.dumps(others)) < MOST_REPEATED else others
    return wild(rng)


def scrambled(data: bytes, rng: random.Random) -> bytes:
    """Bytes of which some are changed, cut off, doubled or moved."""
    changed = bytearray(data)
    for _ in range(rng.choice([1, 2, 8, 40])):
        place = rng.randrange(len(changed) + 1)
        match rng.randrange(5):
            case 0:
                del changed[place:]
            case 1:
                changed[place : place + 8] = rng.randbytes(rng.randrange(9))
            case 2:
                changed[place:place] = changed[place : place + rng.randrange(600)]
            case 3:
                changed[place:place] = rng.choice(
                    [b"\0" * 512, b"\xff" * 8, b"[" * 999, b"{", b'"', b"\n- ", b"&a *a "]
                )
            case _ if place < len(changed):
                changed[place] = rng.randrange(256)
    return bytes(changed)


def spoilt_xml(data: bytes, rng: random.Random) -> bytes:
    """XML that is still XML: values changed, elements repeated, removed or put into one another."""
    root = ElementTree.fromstring(data)
    for _ in range(rng.choice([1, 2, 8])):
        places = list(root.iter())
        one, other = rng.choice(places), rng.choice(places)
        match rng.randrange(5):
            case 0 if one.attrib:
                key = rng.choice(sorted(one.attrib))
                one.set(key, rng.choice(["", "nan", "1e999", "-1", "0", one.get(key, "") * 300, "M0 0 L1", "../x.stl"]))
            case 1 if len(one):
                one.remove(rng.choice(list(one)))
            case 2 if len(one):
                one.extend([copy.deepcopy(rng.choice(list(one)))] * rng.choice([1, 30]))
            case 3:
                other.append(copy.deepcopy(one) if len(list(one.iter())) < 50 else ElementTree.Element("g"))
            case _:
                one.tag = rng.choice(["g", "path", "rect", "link", "joint", one.tag])
    return ElementTree.tostring(root)


def drawn_in_dxf() -> bytes:
    """Two rooms and a door, as a CAD program writes them."""
    document = filemanagement.new("R2010")
    space = document.modelspace()
    for name, x in (("Kitchen", 0), ("Living room", 4)):
        corners = [(x, 0), (x + 4, 0), (x + 4, 4), (x, 4)]
        space.add_lwpolyline(corners, close=True, dxfattribs={"layer": "A-AREA"})
        space.add_text(name, height=0.2).set_placement((x + 2, 2))
    space.add_line((4, 1), (4, 2), dxfattribs={"layer": "A-DOOR"})
    written = io.StringIO()
    document.write(written)
    return written.getvalue().encode()


class Surfaces:
    """What takes what others wrote: each method generates one input and has it taken or refused.

    Args:
        service: An empty service.
        folder: An empty folder.
    """

    def __init__(self, service: Service, folder: Path) -> None:
        self.service, self.folder = service, folder
        self.archives = _archives(folder)
        self.client = Client(Endpoint(service))
        self.operations = [each.shape for each in registry().values()]
        template = {"name": "flat", "templateBody": json.dumps(BODY)}
        self.known = {"CreateSimulationJob": JOB, "CreateWorldTemplate": template, "ListWorlds": {"maxResults": 3}}
        service.store.ensure_bucket("fuzzed")
        self.drawn = {"flat.svg": (SPECS / "plans/flat.svg").read_bytes(), "flat.dxf": drawn_in_dxf()}
        rover = SPECS / "examples/urdf_robot_bundle/my_rover"
        shutil.copytree(rover, folder / "my_rover")
        self.urdf = (rover / "urdf/rover.urdf").read_bytes()
        job = {name: part for name, part in JOB.items() if name != "dataSources"}
        self.job = call("CreateSimulationJob", job, service)["arn"]
        call("CreateSimulationJob", {**job, "clientRequestToken": "other"}, service)
        self.token = call("ListSimulationJobs", {"maxResults": 1}, service)["nextToken"]

    def wire(self, rng: random.Random) -> None:
        shape = rng.choice(self.operations)
        request = self.known.get(shape.name, {"job": f"{ARN}:simulation-job/x", "tags": {"a": "b"}, "name": "x"})
        body = json.dumps(spoilt(request, rng)).encode()
        body = scrambled(body, rng) if rng.random() < 0.3 else body
        path = shape.path if rng.random() < 0.9 else "/" + rng.randbytes(rng.randrange(40)).hex()
        told = self.client.send(shape.method, path, body)
        assert told.status < 500, (shape.name, body[:500], told)

    def specs(self, rng: random.Random) -> None:
        if rng.random() < 0.5:
            load_spec(json.dumps(spoilt(yaml.safe_load(SPEC), rng)), "spec.yaml")
        else:
            load_spec(scrambled(SPEC.encode(), rng).decode(errors="replace"), "spec.yaml")

    def bodies(self, rng: random.Random) -> None:
        body = json.dumps(spoilt(BODY, rng))
        request = {"name": "x", "templateBody": body if rng.random() < 0.8 else body[:-9]}
        call("CreateWorldTemplate", request, self.service)

    def packed(self, rng: random.Random) -> None:
        place = self.folder / "place"
        place.mkdir()
        (place / "archive").write_bytes(_repacked(rng.choice(self.archives), rng))
        try:
            unpack(place / "archive", place / "unpacked")
            unpack_colcon_bundle(place / "unpacked")
        finally:
            assert {path.name for path in place.iterdir()} <= {"archive", "unpacked"}
            shutil.rmtree(place)
            assert not list(self.folder.glob("place*"))

    def keys(self, rng: random.Random) -> None:
        store = self.service.store
        parts = [rng.choice([*TEXTS, "a", "b", ".", "/", "\\", "%2e", "\n"]) for _ in range(rng.randrange(1, 6))]
        key = rng.choice(["/", ""]).join(parts)
        for act in (store.head, store.get_bytes, lambda bucket, key: list(store.list(bucket, key))):
            with suppress(RobomakerError):
                act(rng.choice(["fuzzed", key]), key)

    def frames(self, rng: random.Random) -> None:
        buffer = FrameBuffer({1: 1 << 16, 2: 64})
        sent = scrambled(b"".join(json_message(rng.randrange(1, 4), {"mode": "lockstep"}) for _ in range(9)), rng)
        while sent:
            space = buffer.space()
            count = min(len(space), len(sent), rng.randrange(1, 99))
            space[:count], sent = sent[:count], sent[count:]
            buffer.received(count)
            while buffer.next() is not None:
                pass

    def pages(self, rng: random.Random) -> None:
        shape = rng.choice([each for each in self.operations if each.name.startswith("List")])
        token = scrambled(self.token.encode(), rng).decode(errors="replace")
        request = {"nextToken": token, "maxResults": rng.choice([1, 3, wild(rng)]), "filters": wild(rng)}
        call(shape.name, {name: part for name, part in request.items() if rng.random() < 0.7}, self.service)

    def questions(self, rng: random.Random) -> None:
        question = {"operation": rng.choice(["add_tags", "remove_tags"]), "tags": {"a": "b"}, "keys": ["a"]}
        answer(spoilt(question, rng), self.job, self.service)

    def drawings(self, rng: random.Random) -> None:
        self._drawing(rng.choice(sorted(self.drawn)), rng)

    def drawings_in_svg(self, rng: random.Random) -> None:
        self._drawing("flat.svg", rng)

    def drawings_in_dxf(self, rng: random.Random) -> None:
        self._drawing("flat.dxf", rng)

    def _drawing(self, name: str, rng: random.Random) -> None:
        spoil = spoilt_xml if name.endswith("svg") and rng.random() < 0.7 else scrambled
        path = self.folder / name
        path.write_bytes(spoil(self.drawn[name], rng))
        planned(path, DrawingNotes(), 0)

    def robots(self, rng: random.Random) -> None:
        path = self.folder / "rover.urdf"
        path.write_bytes((spoilt_xml if rng.random() < 0.7 else scrambled)(self.urdf, rng))
        load_model(path, self.folder)


NAMES = ("wire", "specs", "bodies", "packed", "keys", "frames", "pages", "questions", "drawings", "robots")
FILES = ("drawings_in_svg", "drawings_in_dxf", "robots", "specs")
"""Kinds of files that people get from others."""


@pytest.fixture
def surfaces(service: Service, tmp_path: Path) -> Iterator[dict[str, Surface]]:
    """By name: each surface."""
    folder = tmp_path / "own"
    folder.mkdir()
    found = Surfaces(service, folder)
    yield {name: getattr(found, name) for name in (*NAMES, *FILES)}
    found.client.close()


def _archives(folder: Path) -> list[bytes]:
    """A tar, a tar.gz, a zip and a colcon bundle."""
    content = {"package/__init__.py": b"answer = 42\n" * 50, "package/run.sh": b"#!/bin/sh\n", "empty": b""}
    tar, zipped = io.BytesIO(), io.BytesIO()
    with tarfile.open(fileobj=tar, mode="w") as packed:
        for name, data in content.items():
            info = tarfile.TarInfo(name)
            info.size = len(data)
            packed.addfile(info, io.BytesIO(data))
    with zipfile.ZipFile(zipped, "w", zipfile.ZIP_DEFLATED) as packed_zip:
        for name, data in content.items():
            packed_zip.writestr(name, data)
    colcon = folder / "colcon"
    bundle_v1(colcon, {"setup.sh": "", "a": "-> setup.sh", "b/c": "-> ../../.."})
    bundle = colcon.read_bytes()
    colcon.unlink()
    return [tar.getvalue(), gzip.compress(tar.getvalue()), zipped.getvalue(), bundle]


def _repacked(archive: bytes, rng: random.Random) -> bytes:
    """An archive that is damaged, inside of its compression where it has one."""
    if archive.startswith(b"\x1f\x8b") and rng.random() < 0.8:
        return gzip.compress(scrambled(gzip.decompress(archive), rng), 1)
    return scrambled(archive, rng)


def attack(surfaces: dict[str, Surface], seed: int, count: int) -> None:
    """Sends inputs to all surfaces in turn, and says which one broke what.

    Args:
        surfaces: By name.
        seed: Of all of them; each input has a seed of its own, made from it.
        count: How many there are in all.
    """
    before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    slowest: dict[str, float] = {}
    ends: Counter[str] = Counter()
    for number in range(count):
        name = list(surfaces)[number % len(surfaces)]

        def once(name: str = name, number: int = number) -> tuple[float, str]:
            began = time.process_time()
            try:
                surfaces[name](random.Random(f"{seed}-{number}"))
                end = "taken"
            except (RobomakerError, ProtocolError):
                end = "refused"
            except Exception as error:
                error.add_note(f"surface {name}, input {number} of seed {seed}")
                raise
            return time.process_time() - began, end

        took_s, end = once()
        ends[f"{name} {end}"] += 1
        for _ in range(2):  # threads that other tests have left behind count, too: not three times in a row
            if took_s > MOST_CPU_S:
                took_s = min(took_s, once()[0])
        slowest[name] = max(slowest.get(name, 0.0), took_s)
        assert took_s <= MOST_CPU_S, f"surface {name}, input {number} of seed {seed}: {took_s:.2f} CPU-seconds"
    grown_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb
    assert grown_kb < MOST_GROWTH_KB, f"the process grew by {grown_kb} kB"
    print(f"\n{count} inputs of seed {seed}: {dict(sorted(ends.items()))}")
    print(f"the process grew by {grown_kb // 1000} MB at most;", end=" ")
    print("slowest, in CPU-seconds:", {name: round(took_s, 3) for name, took_s in slowest.items()})


@pytest.mark.deep
def test_a_sample_of_generated_inputs(surfaces: dict[str, Surface]) -> None:
    attack({name: surfaces[name] for name in NAMES}, seed=15, count=1_000)


@pytest.mark.endurance
@pytest.mark.timeout(0)
def test_all_generated_inputs(surfaces: dict[str, Surface]) -> None:
    seed = int(os.environ.get("ROBOMAKER_TESTS_SEED", "1"))
    attack({name: surfaces[name] for name in NAMES}, seed=seed, count=100_000)


@pytest.mark.endurance
@pytest.mark.timeout(0)
@pytest.mark.parametrize("name", FILES)
def test_two_thousand_mutated_files_of_a_kind(surfaces: dict[str, Surface], name: str) -> None:
    seed = int(os.environ.get("ROBOMAKER_TESTS_SEED", "32"))
    attack({name: surfaces[name]}, seed=seed, count=2_000)
