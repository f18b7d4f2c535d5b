"""A container engine that runs programs on this machine, and notes how it was called.

It knows images as folders: `config.json` is what `image inspect` tells, `root` is the image's file system. A program
of an image sees the machine's own files; paths that are mounted are put into its environment as they are here.
"""

import hashlib
import json
import stat
import sys
from pathlib import Path

_PROGRAM = r"""
import json, os, signal, subprocess, sys
from contextlib import suppress
from pathlib import Path

HERE = Path(__file__).parent
IMAGES, CONTAINERS = HERE / "images", HERE / "containers"
arguments = sys.argv[1:]
with (HERE / "calls.jsonl").open("a") as calls:
    calls.write(json.dumps(arguments) + "\n")


def fail(words):
    sys.exit(sys.stderr.write(words + "\n") and 1)


def image(name):
    return IMAGES / name.replace("/", "_").replace(":", "_")


def inspected(name):
    try:
        return json.loads((image(name) / "config.json").read_text())
    except OSError:
        fail(f"Error: No such image: {name}")


def create(words):
    environment, name = dict(os.environ), None
    while words[0].startswith("-"):
        option, value = words.pop(0), words.pop(0)
        if option == "--env-file":
            environment |= dict(line.split("=", 1) for line in Path(value).read_text().splitlines())
        if option == "-e":
            environment |= [value.split("=", 1)]
        elif option == "--mount":
            mount = dict(word.split("=", 1) for word in value.split(",") if "=" in word)
            environment["MOUNT" + mount["target"].upper().replace("/", "_")] = mount["source"]
        elif option == "--name":
            name = value
    entry = image(words.pop(0))
    config = inspected(entry.name)["Config"]
    command = (config.get("Entrypoint") or []) + (words or config.get("Cmd") or [])
    if (CONTAINERS / name).exists():
        fail(f'Error response from daemon: Conflict. The container name "/{name}" is already in use by container "0".')
    note(name, {"pid": None, "environment": environment, "command": command, "root": str(entry / "root")})


def note(name, about):
    (CONTAINERS / f".{name}").write_text(json.dumps(about))
    os.rename(CONTAINERS / f".{name}", CONTAINERS / name)


def known(name):
    try:
        return json.loads((CONTAINERS / name).read_text())
    except OSError:
        fail(f"Error: No such container: {name}")


def start(name):
    about = known(name)
    process = subprocess.Popen(about["command"], env=about["environment"], start_new_session=True)
    note(name, {**about, "pid": process.pid})
    code = process.wait()
    code = code if code >= 0 else 128 - code
    if (CONTAINERS / name).exists():
        note(name, {**about, "pid": None, "code": code})
    sys.exit(code)


def remove(name):
    pid = known(name)["pid"]
    # First the file: `start` notes the end of a killed program if it is there, and would make it anew.
    (CONTAINERS / name).unlink(missing_ok=True)
    with suppress(ProcessLookupError):
        if pid is not None:
            os.killpg(pid, signal.SIGKILL)


def need_daemon():
    if (HERE / "no-daemon").exists():
        fail("Cannot connect to the Docker daemon at unix:///var/run/docker.sock.")


match arguments:
    case ["version"]:
        print("Client: fake")
        need_daemon()
    case ["image", "inspect", name]:
        print(json.dumps([inspected(name)]))
    case ["pull", name]:
        if not (HERE / "registry" / image(name).name).exists():
            fail(f"pull access denied for {name}, repository does not exist or may require authorization")
        if not image(name).exists():
            os.rename(HERE / "registry" / image(name).name, image(name))
    case ["info", "--format", "{{.DriverStatus}}"]:
        print("[[driver-type io.containerd.snapshotter.v1]]" if (HERE / "containerd-store").exists() else "[]")
    case ["--version"]:
        print("Docker version 0.0.0, a fake")
    case ["create", *words]:
        create(words)
    case ["cp", source, "-"]:
        name, _, inside = source.partition(":")
        root = Path(known(name)["root"], inside.strip("/").removesuffix("/."))
        if not root.is_dir():
            fail(f"Error response from daemon: Could not find the file {inside} in container {name}")
        subprocess.run(["tar", "-c", "-C", root, "."], check=True)
    case ["rm", "-f", name]:
        need_daemon()
        remove(name)
    case ["inspect", "--format", form, name]:
        about = known(name)
        status = "running" if about["pid"] is not None else "exited" if "code" in about else "created"
        said = form.replace("{{.State.Status}}", status).replace("{{.State.OOMKilled}}", "false")
        print(said.replace("{{.State.ExitCode}}", str(about.get("code", 0))))
    case ["exec", name, *words]:
        os.execvpe(words[0], words, known(name)["environment"])
    case ["kill", "--signal", "TERM", name]:
        os.kill(known(name)["pid"], signal.SIGTERM)
    case ["start", "--attach", name]:
        start(name)
    case _:
        fail(f"unknown: {arguments}")
"""


class FakeEngine:
    """The engine's program in a folder, with images that tests put there."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        for name in ("images", "registry", "containers"):
            (folder / name).mkdir(parents=True)
        self.program = folder / "docker"
        self.program.write_text(f"#!{sys.executable}\n{_PROGRAM}")
        self.program.chmod(self.program.stat().st_mode | stat.S_IXUSR)

    def add_image(
        self, name: str, *, command: list[str], registry: bool = False, digests: tuple[str, ...] = (), **config: object
    ) -> Path:
        """Adds an image; returns its file system.

        Args:
            name: The image's name.
            command: Its `CMD`.
            registry: Whether it has to be pulled first.
            digests: Of its manifest, one for each registry.
            config: Members of the image's configuration such as `Entrypoint`.
        """
        place = self.folder / ("registry" if registry else "images") / name.replace("/", "_").replace(":", "_")
        named = [f"{name.partition(':')[0]}@{digest}" for digest in digests]
        (place / "root").mkdir(parents=True)
        content = {"RepoDigests": named, "Config": {"Cmd": command, **config}}
        content["Id"] = f"sha256:{hashlib.sha256(json.dumps(content).encode()).hexdigest()}"
        (place / "config.json").write_text(json.dumps(content))
        return place / "root"

    def calls(self) -> list[list[str]]:
        """How it was called, in order."""
        path = self.folder / "calls.jsonl"
        return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []

    def containers(self) -> list[str]:
        """Names of all containers, whether they run or not."""
        return sorted(path.name for path in (self.folder / "containers").iterdir())

    def runs(self, name: str) -> bool:
        """Whether a container's program has been started, and noted by the engine."""
        try:
            return json.loads((self.folder / "containers" / name).read_text())["pid"] is not None
        except (FileNotFoundError, ValueError):  # it is written at this moment
            return False

    def lose_daemon(self) -> None:
        """Leaves the client without anybody to talk to."""
        (self.folder / "no-daemon").touch()

    def find_daemon(self) -> None:
        """Ends what `lose_daemon` began."""
        (self.folder / "no-daemon").unlink()

    def keep_images_in_containerd(self) -> None:
        """Has the daemon say that containerd keeps its images."""
        (self.folder / "containerd-store").touch()
