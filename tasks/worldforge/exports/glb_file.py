"""Writes GLB files: glTF 2.0 in one binary file."""

import json
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

_FLOAT, _UINT16, _UINT32 = 5126, 5123, 5125
_ARRAY_BUFFER, _ELEMENT_ARRAY_BUFFER = 34962, 34963
_TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3"}
_LARGEST_UINT16 = 65_535


class GlbFile:
    """A glTF document with its binary buffer.

    Whoever fills it appends to `document`'s lists (`nodes`, `meshes`, `materials`, ...) and refers to
    what `add_values` and `add_image` return.
    """

    def __init__(self) -> None:
        self.document: dict[str, Any] = {"asset": {"version": "2.0", "generator": "prefect-robomaker"}}
        self._buffer = bytearray()

    def append(self, kind: str, entry: dict[str, Any]) -> int:
        """Adds an entry to one of the document's lists; returns its index."""
        entries = self.document.setdefault(kind, [])
        entries.append(entry)
        return len(entries) - 1

    def add_vectors(self, vectors: NDArray[np.floating]) -> int:
        """Adds vertices' positions, normals or texture coordinates, shape (n, 2) or (n, 3); returns the accessor."""
        values = np.ascontiguousarray(vectors, dtype="<f4")
        view = self._add_view(values.tobytes(), _ARRAY_BUFFER)
        entry: dict[str, Any] = {
            "bufferView": view,
            "componentType": _FLOAT,
            "count": len(values),
            "type": _TYPES[values.shape[1]],
            "min": [float(value) for value in values.min(axis=0)],
            "max": [float(value) for value in values.max(axis=0)],
        }
        return self.append("accessors", entry)

    def add_triangles(self, triangles: NDArray[np.integer]) -> int:
        """Adds triangles as triples of vertices; returns the accessor."""
        small = triangles.max() < _LARGEST_UINT16
        values = np.ascontiguousarray(triangles, dtype="<u2" if small else "<u4").ravel()
        view = self._add_view(values.tobytes(), _ELEMENT_ARRAY_BUFFER)
        component = _UINT16 if small else _UINT32
        entry = {"bufferView": view, "componentType": component, "count": len(values), "type": "SCALAR"}
        return self.append("accessors", entry)

    def add_image(self, png: bytes, name: str) -> int:
        """Adds a picture; returns its index."""
        return self.append("images", {"bufferView": self._add_view(png), "mimeType": "image/png", "name": name})

    def to_bytes(self) -> bytes:
        """The file; equal documents give equal bytes."""
        document = {**self.document, "buffers": [{"byteLength": len(self._buffer)}]}
        text = json.dumps(document, separators=(",", ":"), ensure_ascii=False).encode()
        text += b" " * (-len(text) % 4)
        binary = bytes(self._buffer) + bytes(-len(self._buffer) % 4)
        head = struct.pack("<4sII", b"glTF", 2, 12 + 8 + len(text) + 8 + len(binary))
        return b"".join(
            [head, struct.pack("<I4s", len(text), b"JSON"), text, struct.pack("<I4s", len(binary), b"BIN\0"), binary]
        )

    def _add_view(self, content: bytes, target: int | None = None) -> int:
        self._buffer += bytes(-len(self._buffer) % 4)
        view: dict[str, Any] = {"buffer": 0, "byteOffset": len(self._buffer), "byteLength": len(content)}
        if target:
            view["target"] = target
        self._buffer += content
        return self.append("bufferViews", view)
