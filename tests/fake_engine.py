"""A container engine that runs programs on this machine, and notes how it was called.

It knows images as folders: `config.json` is what `image inspect` tells, `root` is the image's file system. A program
of an image sees the machine's own files; paths that are mounted are put into its environment as they are here.
"""

import json
import stat
import sys
from pathlib import Path

_PROGRAM = r"""
import json, os, signal, subprocess, sys
from pathlib import Path

HERE = Path(__file__).parent
IMAGES, RUNNING = HERE / "images", HERE / "running"
arguments = sys.argv[1:]
with (HERE / "calls.jsonl").open("a") as calls:
    calls.write(json.dumps(arguments) + "\n")


def fail(words):
    sys.exit(sys.stderr.write(words + "\n") and 1)


def image(name):
    return IMAGES / name.replace("/", "_").replace(":", "_")


def inspect(name):
    if not image(name).is_dir():
        fail(f"Error: No such image: {name}")
    print(json.dumps([json.loads((image(name) / "config.json").read_text())]))


def run(words):
    environment, mounts, name = dict(os.environ), [], None
    flags = {"--rm"}
    while words[0].startswith("-"):
        option = words.pop(0)
        if option in flags:
            continue
        value = words.pop(0)
        if option == "-e":
            key, _, content = value.partition("=")
            environment[key] = content
        elif option == "-v":
            mounts.append(value.split(":"))
        elif option == "--name":
            name = value
    entry = image(words.pop(0))
    for source, target, *_ in mounts:
        environment["MOUNT" + target.upper().replace("/", "_")] = source
    config = json.loads((entry / "config.json").read_text())["Config"]
    command = (config.get("Entrypoint") or []) + (words or config.get("Cmd") or [])
    process = subprocess.Popen(command, env=environment, start_new_session=True)
    (RUNNING / name).write_text(json.dumps({"pid": process.pid, "environment": environment}))
    code = process.wait()
    (RUNNING / name).unlink(missing_ok=True)
    sys.exit(code if code >= 0 else 128 - code)


def remove(name):
    try:
        running = json.loads((RUNNING / name).read_text())
    except OSError:
        return
    try:
        os.killpg(running["pid"], signal.SIGKILL)
    except ProcessLookupError:
        pass
    (RUNNING / name).unlink(missing_ok=True)


match arguments:
    case ["version"]:
        print("Client: fake")
        if (HERE / "no-daemon").exists():
            fail("Cannot connect to the Docker daemon at unix:///var/run/docker.sock.")
    case ["image", "inspect", name]:
        inspect(name)
    case ["pull", name]:
        if not (HERE / "registry" / image(name).name).exists():
            fail(f"pull access denied for {name}, repository does not exist or may require authorization")
        if not image(name).exists():
            os.rename(HERE / "registry" / image(name).name, image(name))
    case ["create", "--name", name, of, *_]:
        (RUNNING / name).write_text(str(image(of)))
    case ["cp", "-a", source, target]:
        name, _, inside = source.partition(":")
        root = Path((RUNNING / name).read_text(), "root", inside.strip("/").removesuffix("/."))
        if not root.is_dir():
            fail(f"Error response from daemon: Could not find the file {inside} in container {name}")
        subprocess.run(["cp", "-a", f"{root}/.", target], check=True)
    case ["rm", "-f", name]:
        if name.endswith("-image"):
            (RUNNING / name).unlink()
        else:
            remove(name)
    case ["inspect", "--format", _, name]:
        print("true" if (RUNNING / name).exists() else fail("No such object"))
    case ["exec", name, *words]:
        running = json.loads((RUNNING / name).read_text())
        os.execvpe(words[0], words, running["environment"])
    case ["run", *words]:
        run(words)
    case _:
        fail(f"unknown: {arguments}")
"""


class FakeEngine:
    """The engine's program in a folder, with images that tests put there."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        for name in ("images", "registry", "running"):
            (folder / name).mkdir(parents=True)
        self.program = folder / "docker"
        self.program.write_text(f"#!{sys.executable}\n{_PROGRAM}")
        self.program.chmod(self.program.stat().st_mode | stat.S_IXUSR)

    def add_image(
        self, name: str, *, command: list[str], registry: bool = False, digests: tuple[str, ...] = (), **config: object
    ) -> Path:
        """Adds an image; returns its file system.

        Args:
            name: the image's name.
            command: its `CMD`.
            registry: whether it has to be pulled first.
            digests: of its manifest, one for each registry.
            config: members of the image's configuration such as `Entrypoint`.
        """
        place = self.folder / ("registry" if registry else "images") / name.replace("/", "_").replace(":", "_")
        named = [f"{name.partition(':')[0]}@{digest}" for digest in digests]
        (place / "root").mkdir(parents=True)
        content = {"RepoDigests": named, "Config": {"Cmd": command, **config}}
        (place / "config.json").write_text(json.dumps(content))
        return place / "root"

    def calls(self) -> list[list[str]]:
        """How it was called, in order."""
        path = self.folder / "calls.jsonl"
        return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []

    def running(self) -> list[str]:
        """Names of containers that run."""
        return sorted(path.name for path in (self.folder / "running").iterdir())

    def lose_daemon(self) -> None:
        """Leaves the client without anybody to talk to."""
        (self.folder / "no-daemon").touch()
