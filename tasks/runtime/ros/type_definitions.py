"""Definitions of message types by their hashes: those that every ROS 2 has, and those that nodes tell."""

from functools import cache
from typing import Any

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

_STORES = (Stores.ROS2_HUMBLE, Stores.LATEST)
"""The first for nodes that say no hash, since only Humble's do not."""
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
"""Types of fields by the ids of `type_description_interfaces/msg/FieldType`; strings of fixed length are not in ROS."""
_NESTED = 1
_BOUNDED_STRINGS = (21, 22)
_KINDS = 48
"""Step of the ids from a value to an array of them, to a bounded sequence, and to a sequence without a bound."""


def known_definition(ros_type: str, type_hash: str) -> str | None:
    """The definition of a type that all of ROS 2 has, as concatenated `.msg` files.

    Args:
        ros_type: Its name in ROS.
        type_hash: Its hash; empty: none is known, and the type of Humble is taken.

    Returns:
        `None` where it is not among them, or has another hash there.
    """
    for kind in _STORES:
        store = _store(kind)
        if ros_type in store.types and type_hash in ("", store.hash_rihs01(ros_type)):
            return store.generate_msgdef(ros_type, ros_version=2)[0]
    return None


def confirmed_hash(ros_type: str, definition: str, type_hash: str) -> str:
    """A hash that readers may hold against a definition, or empty where they would find another.

    Readers refuse a whole recording for one type whose definition does not have the hash that is said of it, and
    `rosbags` computes another for a few types, such as `std_msgs/msg/Char`.
    """
    if not (definition and type_hash):
        return type_hash
    try:
        store = get_typestore(Stores.EMPTY)
        store.register(get_types_from_msg(definition, ros_type))
        return type_hash if store.hash_rihs01(ros_type) == type_hash else ""
    except Exception:  # its parser has many kinds of errors, and the definition came from a node
        return ""


def request_of(ros_type: str, type_hash: str) -> bytes:
    """A request of `get_type_description` as CDR."""
    store = _asking_store()
    message = store.types[_REQUEST](ros_type, type_hash, True)
    return bytes(store.serialize_cdr(message, _REQUEST, little_endian=True))


def definition_in(reply: bytes, ros_type: str) -> str | None:
    """The definition that a node has told, as concatenated `.msg` files.

    Args:
        reply: CDR of a reply of `get_type_description`, perhaps to somebody else's request.
        ros_type: The type that was asked for.

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
    """One `.msg` file: as its author wrote it, or made of its fields where it has no file, as parts of actions."""
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
