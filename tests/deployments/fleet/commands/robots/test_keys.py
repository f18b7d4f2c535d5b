"""robots enroll --agent, and robots keys, as the guide shows them."""

import json
import re
import shlex
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat
from helpers.paths import REPOSITORY

ROVER = '{"name": "rover", "architecture": "ARM64", "greengrassGroupId": "g"}'


@pytest.fixture
def rover(robomaker) -> None:
    robomaker("call", "CreateRobot", "--input", ROVER)


def test_an_agent_is_told_how_to_enrol(robomaker, rover, monkeypatch) -> None:
    monkeypatch.setenv("ROBOMAKER_ROBOTS_URL", "https://fleet.example.com/")

    said = json.loads(robomaker("robots", "enroll", "rover", "--agent", "-o", "json").out)

    assert re.fullmatch(r"[0-9a-z]{40}-[0-9a-f]{64}", said["token"])
    command = ["robomaker-agent", "enroll", said["token"], "--url", "https://fleet.example.com", "--name", "rover"]
    assert said["agent"] == command
    assert timedelta(minutes=55) < datetime.fromisoformat(said["expires"]) - datetime.now(UTC) < timedelta(hours=1)
    shown = robomaker("robots", "enroll", "rover", "--agent").out
    assert "robomaker-agent enroll " in shown
    assert said["token"] not in shown
    (robot,) = json.loads(robomaker("robots", "list", "-o", "json").out)["robots"]
    assert (robot["kind"], robot["enrolled"]) == ("agent", False)


def test_without_keys_there_is_nothing_to_show_or_sign(robomaker) -> None:
    assert robomaker("robots", "keys", "status").out.startswith("There are no keys yet; ")
    assert robomaker("robots", "keys", "renew").out.startswith("There is nothing to sign")


def test_the_ceremony_of_the_guide(robomaker, rover, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    guide = (REPOSITORY / "docs" / "fleet" / "fleet-trust.md").read_text()
    (commands,) = re.findall(r"^```console\n(\$ robomaker robots keys init.*?)^```$", guide, re.MULTILINE | re.DOTALL)
    said: list[str] = []
    for line in commands.splitlines():
        if line.startswith("$ "):
            words = [_files(word) for word in shlex.split(line[2:], comments=True)]
            ended = robomaker(*words[1:])
            assert ended.code == 0, (line, ended.err)
            said.append(ended.out)

    assert len(said) >= 6
    assert "Root 2 needs 1 more signature" in said[2]
    assert "Root 2 is published" in said[3]
    assert any("new root key: " in each for each in said)
    roles = {
        each["role"]: each for each in json.loads(robomaker("robots", "keys", "status", "-o", "json").out)["roles"]
    }
    assert (roles["root"]["threshold"], len(roles["root"]["keyids"])) == (2, 3)
    assert [each["warning"] for each in roles.values()] == [""] * 4


def test_the_root_says_whose_attestations_agents_believe(robomaker, rover, tmp_path: Path) -> None:
    robomaker("robots", "enroll", "rover", "--agent")
    (own,) = _attested(robomaker)["keys"]
    assert f"attestations of {own[:16]}; applications that need one: none" in robomaker("robots", "keys", "status").out

    assert robomaker("robots", "keys", "renew-root", "--attested", "courier", "--attested", "guard").code == 0
    assert robomaker("robots", "keys", "renew-root", "--not-attested", "guard").code == 0
    assert _attested(robomaker) == {"keys": [own], "applications": ["courier"]}

    other = tmp_path / "other.pub"
    private = Ed25519PrivateKey.generate()
    other.write_bytes(private.public_key().public_bytes(Encoding.PEM, PublicFormat.SubjectPublicKeyInfo))
    assert robomaker("robots", "keys", "renew-root", "--attestation-key", str(other)).code == 0
    (new,) = _attested(robomaker)["keys"]
    assert new != own
    refused = robomaker("robots", "keys", "renew-root", "--attestation-key", str(tmp_path / "none"))
    assert refused.code == 2
    assert f"the public key {tmp_path / 'none'} cannot be read" in refused.err


def _attested(robomaker) -> dict[str, list[str]]:
    return json.loads(robomaker("robots", "keys", "status", "-o", "json").out)["attested"]


def _files(word: str) -> str:
    """What a shell makes of `anna/root-*.pem`: in the guide each holder has one key."""
    if "/" not in word or "*" not in word:
        return word
    holder, _, pattern = word.partition("/")
    folder, place = ("media", ("anna", "ben", "carla").index(holder)) if holder != "new" else ("new", 0)
    return str(sorted(Path(folder).glob(pattern))[place])


@pytest.mark.usefixtures("without_programs")
def test_what_is_to_be_done_ends_with_1_and_is_told_by_doctor(robomaker, rover, home: Path) -> None:
    robomaker("robots", "enroll", "rover", "--agent")
    assert robomaker("robots", "keys", "status").code == 0
    for path in (home / "objects" / "robomaker" / "robots" / "repository" / "metadata").glob("1.snapshot.json"):
        path.write_bytes(b"{}")
    broken = robomaker("robots", "keys", "status")
    assert broken.code == 2
    assert "not what this machine's keys have signed" in broken.err
    findings = {each["subject"]: each for each in json.loads(robomaker("doctor", "-o", "json").out)["findings"]}
    assert findings["robots' keys"]["health"] == "broken"
