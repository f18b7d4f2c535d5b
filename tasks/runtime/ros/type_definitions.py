"""Definitions of ROS message types: standard ones, those in `.msg` files of packages, and those that nodes send."""

import os
import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from functools import cache, cached_property
from itertools import islice
from pathlib import Path
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

_STORES = (Stores.ROS2_HUMBLE, Stores.LATEST)
"""Type stores to search; Humble's is first, for nodes that announce no type hash, which only Humble's nodes do not."""
_SEPARATOR = "=" * 80 + "\n"
SERVICE = "get_type_description"
SERVICE_TYPE = "type_description_interfaces/srv/GetTypeDescription"
_REQUEST = "robomaker_recorder/msg/Request"
_REPLY = "robomaker_recorder/msg/Reply"
_REQUEST_TEXT = "string type_name\nstring type_hash\nbool include_type_sources"
_REPLY_TEXT = """bool successful
string failure_reason
type_description_interfaces/TypeDescription type_description
type_description_interfaces/TypeSource[] type_sources
type_description_interfaces/KeyValue[] extra_information"""
_SIMPLE = {
    2: "int8", 3: "uint8", 4: "int16", 5: "uint16", 6: "int32", 7: "uint32", 8: "int64", 9: "uint64",
    10: "float32", 11: "float64", 13: "char", 15: "bool", 16: "byte", 17: "string", 18: "wstring",
    21: "string", 22: "wstring",
}  # fmt: skip
"""Names of field types by the ids of `type_description_interfaces/msg/FieldType`; fixed-length strings do not exist in
ROS.
"""
_NESTED = 1
_BOUNDED_STRINGS = (21, 22)
_KINDS = 48
"""Difference between the ids of a value, an array, a bounded sequence and an unbounded sequence of a type."""


def known_definition(ros_type: str, type_hash: str) -> str | None:
    """Returns the definition of a standard ROS 2 message type, as concatenated `.msg` files.

    Args:
        ros_type: ROS name of the type.
        type_hash: Hash of the type; empty: unknown, and the type of Humble is used.

    Returns:
        `None` where it is not among them, or has another hash there.
    """
    for kind in _STORES:
        store = _store(kind)
        if ros_type in store.types and type_hash in ("", store.hash_rihs01(ros_type)):
            return store.generate_msgdef(ros_type, ros_version=2)[0]
    return None


_MOST_FOLDERS = 20_000
"""Maximum number of folders that are searched for packages: a built workspace of Nav2 has 6,000, which takes 0.3 s."""
_DEEPEST = 7
"""Maximum depth of folders that are searched for packages: `opt/ros/jazzy/share/PACKAGE/msg` of a bundle has six
levels.
"""
_NOT_OF_PACKAGES = frozenset({"bin", "doc", "include", "lib", "log", "node_modules", "proc", "site-packages", "sys"})
_MOST_FILE_BYTES = 256 * 1024
_EVENT, _REQUEST_OF, _RESPONSE_OF = "_Event", "_Request", "_Response"
_EVENT_TEXT = """service_msgs/ServiceEventInfo info
{service}_Request[<=1] request
{service}_Response[<=1] response
"""
"""Definition of the messages that ROS 2 publishes on `/NAME/_service_event`."""


class PackageFiles:
    """Type definitions in `.msg` and `.srv` files of packages, searched on first use."""

    def __init__(self, folders: Sequence[Path]) -> None:
        """Stores the folders in which ROS packages may be, without searching them yet.

        Args:
            folders: Folders of bundles and ROS installations, with packages at any depth; the first that has a package
                is used.
        """
        self._roots = folders

    def definition(self, ros_type: str, type_hash: str) -> str | None:
        """Returns the definition of a type, as concatenated `.msg` files.

        Args:
            ros_type: ROS name of the type.
            type_hash: Hash of the type; empty: unknown, and the first file of that name is used.

        Returns:
            `None` where there is no such file, or it has another hash.
        """
        package, _, name = ros_type.split("/")
        for folder in self._folders.get(package, ()):
            texts: dict[str, str] = {}
            with suppress(Exception):  # the parser has many kinds of errors, and files are a user's
                self._gather(ros_type, self._text(folder, name), texts)
                first, *others = texts
                sections = [f"{_SEPARATOR}MSG: {each}\n{texts[each]}" for each in others]
                definition = texts[first] + "".join(sections)
                if not type_hash or _hash_of(ros_type, definition, characters_as="uint8") == type_hash:
                    return definition
        return None

    @cached_property
    def _folders(self) -> dict[str, list[Path]]:
        """Folders of packages with type definitions, by package name."""
        found: dict[str, list[Path]] = {}
        for folder in islice(self._walk(), _MOST_FOLDERS):
            if folder.name in ("msg", "srv"):
                known = found.setdefault(folder.parent.name, [])
                if folder.parent not in known:
                    known.append(folder.parent)
        return found

    def _walk(self) -> Iterator[Path]:
        for root in self._roots:
            for place, folders, _ in os.walk(root):
                path = Path(place)
                yield path
                is_deepest = len(path.relative_to(root).parts) >= _DEEPEST
                folders[:] = [] if is_deepest else sorted(set(folders) - _NOT_OF_PACKAGES)

    def _text(self, package: Path, name: str) -> str:
        """Reads the definition of a type from a package's files; a service has three types.

        Raises:
            OSError: The package has no definition file for the type.
        """
        service, _, part = name.rpartition("_")
        path = package / "srv" / f"{service}.srv"
        if f"_{part}" not in (_EVENT, _REQUEST_OF, _RESPONSE_OF) or not path.is_file():
            return _read(package / "msg" / f"{name}.msg")
        request, _, response = f"\n{_read(path)}".partition("\n---")
        texts = {_REQUEST_OF: request, _RESPONSE_OF: response}
        return texts.get(f"_{part}", _EVENT_TEXT.format(service=f"{package.name}/{service}"))

    def _gather(self, ros_type: str, text: str, texts: dict[str, str]) -> None:
        """Adds the definitions of a type and of all types that it contains, by type name.

        Raises:
            Exception: The definition of a type is missing or invalid.
        """
        package, _, name = ros_type.split("/")
        texts[f"{package}/{name}"] = text if text.endswith("\n") else f"{text}\n"
        (members,) = get_types_from_msg(text, f"{package}/msg/{name}").values()
        for needed in _types_in(members[1]):
            package, _, name = needed.split("/")
            if f"{package}/{name}" not in texts:
                self._gather(needed, self._needed(package, name, needed), texts)

    def _needed(self, package: str, name: str, ros_type: str) -> str:
        for folder in self._folders.get(package, ()):
            with suppress(OSError):
                return self._text(folder, name)
        return _store(Stores.LATEST).generate_msgdef(ros_type, ros_version=2)[0].partition(_SEPARATOR)[0]


def _read(path: Path) -> str:
    """Returns the text of a ROS definition file.

    Raises:
        OSError: The path is not a regular file, or the file is too large.
    """
    if not path.is_file() or path.stat().st_size > _MOST_FILE_BYTES:  # a pipe would keep who reads it waiting
        raise FileNotFoundError(path)
    return path.read_text(errors="replace")


def _types_in(members: Sequence[tuple[str, Any]]) -> Iterator[str]:
    """Yields the message types of fields, without numbers and text."""
    for _, (node, about) in members:
        if node in (Nodetype.ARRAY, Nodetype.SEQUENCE):
            node, about = about[0]
        if node == Nodetype.NAME:
            yield about


def _hash_of(ros_type: str, definition: str, characters_as: str = "char") -> str:
    """Computes the hash of a definition; ROS 2 itself hashes `char` as `uint8`, `rosbags` does not.

    Raises:
        Exception: The text is not a message definition.
    """
    store = get_typestore(Stores.EMPTY)
    store.register(_types_of(definition, ros_type, characters_as))
    return store.hash_rihs01(ros_type)


def _types_of(definition: str, ros_type: str, characters_as: str) -> Any:
    """Parses the types of a ROS definition, by their names.

    The parser reads the types of a service as messages; in the result they have their own names, `package/srv/…`.

    Args:
        definition: Text of the definition.
        ros_type: Its type, such as `std_msgs/msg/String`.
        characters_as: Type that a field of type `char` gets.
    """
    package, kind, name = ros_type.split("/")
    parsed = get_types_from_msg(definition, f"{package}/msg/{name}")
    service = re.escape(name.rpartition("_")[0])
    of_service = re.compile(rf"{re.escape(package)}/msg/({service}_(?:Request|Response|Event))")

    def renamed(part: Any) -> Any:
        if part == ("char", 0):
            return characters_as, 0
        if isinstance(part, str):
            match = of_service.fullmatch(part) if kind == "srv" else None
            return f"{package}/srv/{match[1]}" if match else part
        if isinstance(part, tuple | list):
            return type(part)(map(renamed, part))
        return part

    return {renamed(each): renamed(members) for each, members in parsed.items()}


def confirmed_hash(ros_type: str, definition: str, type_hash: str) -> str:
    """Returns a message type's hash if readers would compute the same from its definition, else empty.

    Readers refuse a whole recording for one type whose definition does not have the stated hash, and `rosbags` computes
    a different one for a few types, such as `std_msgs/msg/Char`.
    """
    if not (definition and type_hash):
        return type_hash
    try:
        return type_hash if _hash_of(ros_type, definition) == type_hash else ""
    except Exception:  # its parser has many kinds of errors, and the definition came from a node
        return ""


def request_of(ros_type: str, type_hash: str) -> bytes:
    """Returns the request of the service `get_type_description` for a message type, as CDR bytes."""
    store = _asking_store()
    message = store.types[_REQUEST](ros_type, type_hash, True)
    return bytes(store.serialize_cdr(message, _REQUEST, little_endian=True))


def definition_in(reply: bytes, ros_type: str) -> str | None:
    """Parses the type definition in a `get_type_description` reply.

    Args:
        reply: CDR of a reply of `get_type_description`, possibly to another client's request.
        ros_type: Type that was requested.

    Returns:
        `None`: the reply is about another type, or the node does not know this one.
    """
    try:
        said: Any = _asking_store().deserialize_cdr(reply, _REPLY)
        main = said.type_description.type_description
        if not said.successful or main.type_name != ros_type:
            return None
        sources = {source.type_name: source for source in said.type_sources}
        descriptions = [main, *said.type_description.referenced_type_descriptions]
        texts = [_text(each, sources.get(each.type_name)) for each in descriptions]
    except (AssertionError, ValueError, KeyError, IndexError, TypeError, AttributeError, UnicodeError):
        return None  # a reply that is none; `rosbags` raises what it meets
    names = [f"{_SEPARATOR}MSG: {each.type_name.replace('/msg/', '/')}\n" for each in descriptions]
    return texts[0] + "".join(name + text for name, text in zip(names[1:], texts[1:], strict=True))


def _text(description: Any, source: Any) -> str:
    """Returns the text of a `.msg` file: the original, or one made from the type's fields if it has no file."""
    if source is not None and source.encoding == "msg" and source.raw_file_contents:
        text = str(source.raw_file_contents)
        return text if text.endswith("\n") else f"{text}\n"
    return "".join(f"{_field_type(field.type)} {field.name}\n" for field in description.fields)


def _field_type(field: Any) -> str:
    shape, simple = divmod(int(field.type_id), _KINDS)
    name = field.nested_type_name.replace("/msg/", "/") if simple == _NESTED else _SIMPLE[simple]
    if simple in _BOUNDED_STRINGS:
        name += f"<={int(field.string_capacity)}"
    capacity = int(field.capacity)
    return name + ("", f"[{capacity}]", f"[<={capacity}]", "[]")[shape]


@cache
def _store(kind: Stores) -> Typestore:
    return get_typestore(kind)


@cache
def _asking_store() -> Typestore:
    store = get_typestore(Stores.LATEST)
    store.register(get_types_from_msg(_REQUEST_TEXT, _REQUEST))
    store.register(get_types_from_msg(_REPLY_TEXT, _REPLY))
    return store
