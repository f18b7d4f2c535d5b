"""A registry of container images on this machine: what engines need of it to pull (OCI distribution specification)."""

import gzip
import hashlib
import json
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

_MANIFEST = "application/vnd.docker.distribution.manifest.v2+json"
_CONFIG = "application/vnd.docker.container.image.v1+json"
_LAYER = "application/vnd.docker.image.rootfs.diff.tar.gzip"


class ImageRegistry:
    """Images by their names; engines pull from it without TLS, as its address is this machine's."""

    def __init__(self, port: int) -> None:
        self.address = f"127.0.0.1:{port}"
        self.manifests: dict[str, bytes] = {}
        self.blobs: dict[str, bytes] = {}
        self.asked = threading.Event()
        """Somebody wants a layer."""

        self.answers = threading.Event()
        """Cleared, it answers no request for one."""

        self.answers.set()

    def add_image(self, name: str, root: bytes, **config: Any) -> str:
        """Adds an image, in place of what had the name; returns the digest of its manifest.

        Args:
            name: Such as `robot:1`.
            root: Its root file system, a tar archive.
            config: Members of its configuration such as `Cmd`.
        """
        layer = gzip.compress(root, 1, mtime=0)
        rootfs = {"type": "layers", "diff_ids": [_digest(root)]}
        described = {"architecture": "amd64", "os": "linux", "config": config, "rootfs": rootfs, "history": [{}]}
        about = json.dumps(described).encode()
        manifest = {
            "schemaVersion": 2,
            "mediaType": _MANIFEST,
            "config": {"mediaType": _CONFIG, "size": len(about), "digest": _digest(about)},
            "layers": [{"mediaType": _LAYER, "size": len(layer), "digest": _digest(layer)}],
        }
        content = json.dumps(manifest).encode()
        self.blobs |= {_digest(about): about, _digest(layer): layer}
        repository, _, tag = name.partition(":")
        for reference in (tag or "latest", _digest(content)):
            self.manifests[f"{repository}/manifests/{reference}"] = content
        return _digest(content)

    def find(self, path: str) -> tuple[bytes, str] | None:
        """What is below `/v2/` at a path, with its type; waits for layers while they are held back."""
        if not path:
            return b"{}", "application/json"
        if (manifest := self.manifests.get(path)) is not None:
            return manifest, _MANIFEST
        blob = self.blobs.get(path.rpartition("/")[2])
        if blob is None:
            return None
        self.asked.set()
        self.answers.wait(200)
        return blob, "application/octet-stream"


@contextmanager
def image_registry() -> Iterator[ImageRegistry]:
    """A registry that answers as long as the context lasts."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            found = registry.find(self.path.removeprefix("/v2").strip("/"))
            self.send_response(404 if found is None else 200)
            content, kind = found or (b'{"errors": [{"code": "NAME_UNKNOWN"}]}', "application/json")
            headers: Mapping[str, str] = {
                "Content-Type": kind,
                "Content-Length": str(len(content)),
                "Docker-Content-Digest": _digest(content),
                "Docker-Distribution-Api-Version": "registry/2.0",
            }
            for name, value in headers.items():
                self.send_header(name, value)
            self.end_headers()
            if self.command == "GET":
                self.wfile.write(content)

        do_HEAD = do_GET  # noqa: N815 - the name that the base class looks for

        def log_message(self, format: str, *words: object) -> None:  # noqa: A002 - its name there
            del format, words

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    registry = ImageRegistry(server.server_address[1])
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield registry
    finally:
        registry.answers.set()
        server.shutdown()
        server.server_close()
        thread.join()


def _digest(content: bytes) -> str:
    return f"sha256:{hashlib.sha256(content).hexdigest()}"
