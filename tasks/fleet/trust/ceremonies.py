# pyright: reportPrivateImportUsage=false
"""Key ceremonies of the TUF repository.

They create root keys for storage elsewhere, and let several holders sign a root.
"""

from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

from securesystemslib.signer import CryptoSigner, Key
from tuf.api.metadata import Metadata, Root
from tuf.api.serialization import DeserializationError

from ....schemas.wire.errors import ConfigurationError
from .keys import KeyFolder, new_key, read_key, write_private
from .metadata import (
    Attested,
    Changes,
    check_ceremony,
    first_root,
    following_root,
    missing_signatures,
    sign_root,
    to_bytes,
    to_metadata,
)
from .publishing import Coming, Publisher, roles_signed
from .roles import APPLICATIONS, KEY_ROLES, ONLINE_ROLES

ROOT = "root"


class AttestedChange(NamedTuple):
    """Changes that a new TUF root makes to the attestation rules: valid keys, applications that need them."""

    keys: Sequence[Key] = ()
    """Public keys whose attestations agents accept from now on; empty: the same as before."""

    add: Sequence[str] = ()
    """Applications that need an attestation from now on."""

    remove: Sequence[str] = ()
    """Applications that no longer need an attestation."""


NO_CHANGE = AttestedChange()


def begin_apart(
    publisher: Publisher, root_keys: int, threshold: int, folder: Path, change: AttestedChange = NO_CHANGE
) -> Metadata[Root]:
    """Creates the update repository's first TUF root, with root keys stored apart (such as on a USB stick).

    Args:
        publisher: Publisher on this machine; it gets the keys of the other roles.
        root_keys: Number of root keys to make.
        threshold: Number of root keys that must sign a root.
        folder: Folder for the root keys, such as on a removable medium; it is created.
        change: Changes of its rules about attestations; without keys, it names the key of this machine.

    Raises:
        ConfigurationError: There is a repository already, the numbers make no sense, or a folder cannot be used.
    """
    check_ceremony(root_keys, threshold)
    machine = publisher.machine
    with machine.keys.held():
        if machine.root() is not None:
            raise ConfigurationError(
                f"there are keys already, in {machine.folder}; `robomaker robots keys renew-root --rotate root "
                "--to FOLDER` moves the root keys elsewhere"
            )
        apart = KeyFolder(folder)
        with apart.held():
            roots = [new_key(ROOT, folder, publisher.random_bytes) for _ in range(root_keys)]
        online = {role: new_key(role, machine.folder, publisher.random_bytes) for role in KEY_ROLES if role != ROOT}
        keys = {role: online[role].public_key for role in ONLINE_ROLES}
        attested = _attested(publisher, Attested(), change)
        root = first_root(roots, threshold, keys, publisher.clock(), attested)
        machine.note_root(to_bytes(root))
    publisher.publish(lambda current: None if current else Changes())
    return root


def rotate_applications(publisher: Publisher) -> None:
    """Replaces the key that signs all applications' updates; no root signature is needed.

    Raises:
        ConfigurationError: A key is missing.
        StorageError: The object store does not answer.
    """
    machine = publisher.machine
    publisher.root()
    with machine.keys.held():
        key = new_key(APPLICATIONS, machine.folder, publisher.random_bytes)
    everything = publisher.publish(
        lambda current: Changes(resign=frozenset(roles_signed(current))), None, Coming(applications=key)
    )
    if everything is not None:
        machine.keys.remove_others(APPLICATIONS, {key.public_key.keyid})


class RenewedRoot(NamedTuple):
    """Result of a root ceremony, in which key holders sign a new TUF root."""

    version: int
    expires: datetime
    missing: int
    """Number of signatures that a new TUF root still lacks; 0: it is published."""

    new_keys: list[Path]
    """Files of new TUF root keys, which have signed the new root already."""


def renew_root(
    publisher: Publisher,
    rotate: Sequence[str],
    key_files: Sequence[Path],
    folder: Path | None,
    change: AttestedChange = NO_CHANGE,
) -> RenewedRoot:
    """Creates the next TUF root, or continues with the draft that waits, and adds signatures.

    Args:
        publisher: Publisher on this machine.
        rotate: Roles that get new keys.
        key_files: Root keys of holders; nothing: those in the data home.
        folder: Folder for new root keys; `None`: the data home.
        change: Changes of its rules about attestations.

    Raises:
        ConfigurationError: A file is no root key, or a root that was made with other roles in mind waits.
        StorageError: The object store does not answer.
    """
    known = publisher.root()
    given = [read_key(path) for path in key_files]
    if _waiting(publisher, known) is None:  # a wrong key leaves nothing behind
        sign_root(following_root(known, publisher.clock(), {}), known, given or _own_keys(publisher, known, known))
    draft, made = draft_root(publisher, rotate, folder, change)
    files = [*key_files, *made] if key_files else []
    missing = sign_draft(publisher, draft, files)
    return RenewedRoot(draft.signed.version, draft.signed.expires, missing, made)


def draft_root(
    publisher: Publisher, rotate: Sequence[str], folder: Path | None, change: AttestedChange = NO_CHANGE
) -> tuple[Metadata[Root], list[Path]]:
    """Returns the draft of the next TUF root that waits for signatures; creates one if there is none.

    Args:
        publisher: Publisher on this machine.
        rotate: Roles that get new keys; nothing: the same keys, valid for longer.
        folder: Folder for new root keys, as many as before; `None`: the data home.
        change: Changes of its rules about attestations.

    Returns:
        The root, and the files of new root keys, which have to sign it as well.

    Raises:
        ConfigurationError: Another draft waits for signatures, and `rotate` or `change` asks for a new one.
    """
    known, machine = publisher.root(), publisher.machine
    waiting = _waiting(publisher, known)
    if waiting is not None:
        if rotate or change != NO_CHANGE:
            raise ConfigurationError(
                f"a root waits for signatures in {machine.draft_path}; sign that one without --rotate and what is said "
                "of attestations, or remove it"
            )
        return waiting, []
    attested = _attested(publisher, Attested.of(known.signed), change) if change != NO_CHANGE else None
    with machine.keys.held():
        replaced: dict[str, Sequence[Key]] = {}
        for role in rotate:
            if role != ROOT:
                replaced[role] = [new_key(role, machine.folder, publisher.random_bytes).public_key]
        made: list[Path] = []
        if ROOT in rotate:
            replaced[ROOT], made = _new_root_keys(publisher, known, folder)
        draft = following_root(known, publisher.clock(), replaced, attested)
        write_private(machine.draft_path, to_bytes(draft), replace=True)
    return draft, made


def sign_draft(publisher: Publisher, draft: Metadata[Root], key_files: Sequence[Path]) -> int:
    """Adds signatures to the draft of a TUF root, and publishes it once it has enough.

    Args:
        publisher: Publisher on this machine.
        draft: The root, from `draft_root`.
        key_files: Files of root keys; empty: those in the data home.

    Returns:
        Number of signatures that the root still needs; 0: it is published.

    Raises:
        ConfigurationError: A file is no key, or none of a root key.
        StorageError: The object store does not answer.
    """
    known, machine = publisher.root(), publisher.machine
    signers = [read_key(path) for path in key_files] or _own_keys(publisher, draft, known)
    sign_root(draft, known, signers)
    with machine.keys.held():
        write_private(machine.draft_path, to_bytes(draft), replace=True)
    missing = missing_signatures(draft, known)
    if not missing:
        _publish_root(publisher, draft)
    return missing


def _attested(publisher: Publisher, before: Attested, change: AttestedChange) -> Attested:
    """Returns the attestation rules of a new root; if they demand attestations, they name at least one key."""
    wanted = before.changed(change.keys, change.add, change.remove)
    return wanted if wanted.keys else publisher.attested().changed((), wanted.applications, ())


def _publish_root(publisher: Publisher, root: Metadata[Root]) -> None:
    # First what both the old and the new keys have signed: a robot may have either root at any moment.
    publisher.publish(lambda current: Changes(resign=frozenset(roles_signed(current))), None, Coming(root=root))
    if not publisher.files.write(ROOT, root.signed.version, to_bytes(root)):
        raise ConfigurationError(
            f"another machine published root {root.signed.version} meanwhile; "
            f"remove {publisher.machine.draft_path} and begin again"
        )
    publisher.root()
    with publisher.machine.keys.held():
        publisher.machine.draft_path.unlink(missing_ok=True)
        for role in (ROOT, *ONLINE_ROLES):
            publisher.machine.keys.remove_others(role, root.signed.roles[role].keyids)


def _waiting(publisher: Publisher, known: Metadata[Root]) -> Metadata[Root] | None:
    path = publisher.machine.draft_path
    try:
        draft = to_metadata(path.read_bytes(), Root)
    except FileNotFoundError:
        return None
    except (OSError, DeserializationError) as error:
        raise ConfigurationError(f"{path} is no root: {error}; remove it and begin again") from error
    if draft.signed.version != known.signed.version + 1:
        raise ConfigurationError(
            f"{path} is root {draft.signed.version}, and the newest is {known.signed.version}; "
            "remove it and begin again"
        )
    return draft


def _new_root_keys(
    publisher: Publisher, known: Metadata[Root], folder: Path | None
) -> tuple[Sequence[Key], list[Path]]:
    count = len(known.signed.roles[ROOT].keyids)
    place = KeyFolder(folder) if folder is not None else publisher.machine.keys
    if folder is not None:
        with place.held():
            pass
    before = set(place.path.glob(f"{ROOT}-*.pem"))
    keys = [new_key(ROOT, place.path, publisher.random_bytes).public_key for _ in range(count)]
    return keys, sorted(set(place.path.glob(f"{ROOT}-*.pem")) - before)


def _own_keys(publisher: Publisher, draft: Metadata[Root], known: Metadata[Root]) -> list[CryptoSigner]:
    counting: Mapping[str, None] = dict.fromkeys([*draft.signed.roles[ROOT].keyids, *known.signed.roles[ROOT].keyids])
    keys = [key for key in publisher.machine.keys.of_role(ROOT) if key.public_key.keyid in counting]
    if not keys:
        raise ConfigurationError(
            "the root keys are not on this machine; name their files with --key, one for each holder"
        )
    return keys
