"""Environments of other people's programs, made once and kept in pytest's cache folder."""

import fcntl
import json
import os
import shutil
import subprocess
import sys
import venv
from collections.abc import Callable
from pathlib import Path

import pytest

from helpers.package_installer import install_packages
from helpers.required_programs import missing

OLD_PYTHON_CLIENTS = ("boto3==1.40.60", "botocore==1.40.60", "awscli==1.42.60")
"""The last releases that have the service by themselves."""


def python_environment(config: pytest.Config) -> Path:
    """Folder of programs of an environment with boto3 and the AWS CLI as they last had the service."""
    return _python_with(config, "python", OLD_PYTHON_CLIENTS)


def mujoco_environment(config: pytest.Config, version: str) -> Path:
    """Folder of programs of an environment with a release of MuJoCo; skips the test where it cannot be had."""
    return _python_with(config, f"mujoco-{version}", (f"mujoco=={version}",))


def mujoco_warp_environment(config: pytest.Config) -> Path:
    """Folder of programs of an environment with mujoco-warp; skips the test where it cannot be had."""
    return _python_with(config, "mujoco-warp", ("mujoco==3.17.0", "mujoco-warp==3.17.0"))


RCLPY = (
    *("ros-jazzy-rclpy==7.1.6", "ros-jazzy-common-interfaces==5.3.6"),
    *("ros-jazzy-rmw-fastrtps-cpp==8.4.3", "ros-jazzy-rosgraph-msgs==2.0.3"),
)
"""ROS 2 Jazzy for Python, with Fast DDS; 280 MB. It is for tests only: one person builds these wheels."""


def rclpy_environment(config: pytest.Config) -> Path:
    """Folder of programs of an environment with ROS 2's rclpy; skips the test where it cannot be had."""
    try:
        return _python_with(config, "rclpy", RCLPY, built="empy")
    except pytest.skip.Exception as reason:
        missing("rclpy", str(reason))


def kept_folder(config: pytest.Config, name: str) -> Path:
    """A folder that later runs of the tests find again, such as for what a client compiles."""
    assert config.cache is not None
    return config.cache.mkdir(f"robomaker-{name}")


def usd_environment(config: pytest.Config) -> Path:
    """Folder of programs of an environment with USD's own library; skips the test where it cannot be had."""
    return _python_with(config, "usd", ("usd-core==26.11",))


def old_botocore(config: pytest.Config, version: str) -> Path:
    """Folder of programs of an environment with a release of botocore; skips the test where it cannot be had."""
    return _python_with(config, f"botocore-{version}", (f"botocore=={version}",))


AWS_CLI_OF_DEBIAN_12 = "2.9.19"
_ITS_PACKAGES = (
    *("awscli", "python3-awscrt", "python3-botocore", "python3-colorama", "python3-cryptography", "python3-dateutil"),
    *("python3-distro", "python3-docutils", "python3-jmespath", "python3-prompt-toolkit", "python3-ruamel.yaml"),
    *("python3-urllib3", "python3-wcwidth"),
)


def debian_aws_cli(config: pytest.Config) -> list[str]:
    """The command of Debian 12's AWS CLI, unpacked beside the system; skips the test on other systems."""
    release = Path("/etc/os-release")
    if not (shutil.which("apt-get") and release.is_file() and "bookworm" in release.read_text()):
        pytest.skip("this is no Debian 12: its AWS CLI cannot be had")

    def make(folder: Path) -> None:
        folder.mkdir()
        command = ["apt-get", "download", "-q", *_ITS_PACKAGES]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=240, check=False)
        if done.returncode != 0:
            pytest.skip(f"Debian's AWS CLI cannot be downloaded: {done.stderr.strip()[-300:]}")
        for package in folder.glob("*.deb"):
            subprocess.run(["dpkg", "-x", str(package), str(folder / "root")], check=True)

    root = _kept(config, "debian-aws-cli", [AWS_CLI_OF_DEBIAN_12, *_ITS_PACKAGES], make) / "root"
    path = f"PYTHONPATH={root}/usr/lib/python3/dist-packages"
    return ["env", path, "/usr/bin/python3", f"{root}/usr/bin/aws"]


def _python_with(config: pytest.Config, name: str, requirements: tuple[str, ...], built: str | None = None) -> Path:
    def make(folder: Path) -> None:
        venv.create(folder, symlinks=True, with_pip=False)
        install_packages(*requirements, python=folder / "bin" / "python", built=built)

    version = ".".join(map(str, sys.version_info[:3]))
    return _kept(config, name, [version, *requirements], make) / "bin"


def node_modules(config: pytest.Config, project: Path) -> Path:
    """Folder of the modules that a folder's `package.json` asks for; skips the test where they cannot be had."""
    for program in ("node", "npm"):
        if not shutil.which(program):
            missing("node", f"{program} is not installed: {project.name} cannot be tried")
    files = [project / name for name in ("package.json", "package-lock.json")]

    def make(folder: Path) -> None:
        folder.mkdir()
        for file in files:
            shutil.copy(file, folder)
        command = ["npm", "ci", "--no-audit", "--no-fund", "--ignore-scripts", "--loglevel=error"]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=240, check=False)
        if done.returncode != 0:
            pytest.skip(f"what {project.name} needs cannot be installed: {done.stderr.strip()[-300:]}")

    return _kept(config, project.name, [file.read_text() for file in files], make) / "node_modules"


def _kept(config: pytest.Config, name: str, contents: list[str], make: Callable[[Path], None]) -> Path:
    """A folder that is made when it is not there with these contents; workers wait for each other."""
    assert config.cache is not None
    place = config.cache.mkdir("robomaker-clients")
    folder = place / name
    record = place / f"{name}.json"  # written last: a folder without it is a broken one
    with (place / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not record.exists() or json.loads(record.read_text()) != contents:
            record.unlink(missing_ok=True)
            shutil.rmtree(folder, ignore_errors=True)
            make(folder)
            record.write_text(json.dumps(contents))
    return folder


def run_client(
    command: list[str], environ: dict[str, str], given: str = "", folder: Path | None = None, timeout_s: float = 280
) -> str:
    """Runs somebody's program with an environment of its own, and returns what it printed."""
    kept = {name: os.environ[name] for name in ("PATH", "LANG", "LC_ALL") if name in os.environ}
    done = subprocess.run(
        command,
        input=given,
        capture_output=True,
        text=True,
        env={**kept, **environ},
        cwd=folder,
        timeout=timeout_s,
        check=False,
    )
    assert done.returncode == 0, f"{command} ended with {done.returncode}\n{done.stdout[-2000:]}\n{done.stderr[-6000:]}"
    return done.stdout
