# pyright: reportPrivateImportUsage=false
"""Roots: the first, which robots know by its hash, and those that follow. A root says whose signatures count.

Beside what TUF knows, it names the keys whose attestations agents believe, and the applications that need one. Root
keys may lie elsewhere, so who has the server cannot change that.
"""

from collections.abc import Collection, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, field
from datetime import datetime

from securesystemslib.signer import Signer
from tuf.api.metadata import Key, Metadata, Root

from ....schemas.wire.errors import ConfigurationError
from .metadata import signed
from .roles import ONLINE_ROLES, lifetime_of

MOST_ROOT_KEYS = 16
"""People do not keep more."""

EVERY_APPLICATION = "*"
"""Stands for all of them among the applications that need an attestation."""

_ATTESTED = "robomaker-attested"


@dataclass(frozen=True)
class Attested:
    """Attestation rules that a root of the repository sets."""

    keys: Mapping[str, Key] = field(default_factory=dict[str, Key])
    """Those that agents believe, by id; none: agents do not look at attestations."""

    applications: frozenset[str] = frozenset()
    """Applications of which agents install nothing that was not attested."""

    @classmethod
    def of(cls, root: Root) -> "Attested":
        """Reads it from a root."""
        content = root.unrecognized_fields.get(_ATTESTED) or {"keys": {}, "applications": []}
        keys = {keyid: Key.from_dict(keyid, dict(key)) for keyid, key in content["keys"].items()}
        return cls(keys, frozenset(content["applications"]))

    def changed(self, keys: Collection[Key], add: Collection[str], remove: Collection[str]) -> "Attested":
        """With other keys, if any are given, and with more or fewer applications."""
        named = {key.keyid: key for key in keys} or self.keys
        return Attested(named, (self.applications | frozenset(add)) - frozenset(remove))

    def demands(self, application: str) -> bool:
        """Whether each deployment of an application needs an attestation."""
        return not self.applications.isdisjoint((application, EVERY_APPLICATION))

    def write_to(self, root: Root) -> None:
        """Makes a root say it."""
        keys = {keyid: key.to_dict() for keyid, key in self.keys.items()}
        root.unrecognized_fields[_ATTESTED] = {"keys": keys, "applications": sorted(self.applications)}


def check_ceremony(root_keys: int, threshold: int) -> None:
    """Refuses numbers of keys that make no sense.

    Raises:
        ConfigurationError: names the number and what would be right.
    """
    if not 1 <= root_keys <= MOST_ROOT_KEYS:
        raise ConfigurationError(f"root keys: {root_keys} is not right; 1 to {MOST_ROOT_KEYS} are")
    if not 1 <= threshold <= root_keys:
        raise ConfigurationError(f"threshold: {threshold} is not right; 1 to {root_keys}, the number of keys, are")


def first_root(
    root_keys: Sequence[Signer], threshold: int, online: Mapping[str, Key], now: datetime, attested: Attested
) -> Metadata[Root]:
    """The first root, signed by all root keys.

    Args:
        root_keys: whose signatures make the next root.
        threshold: how many of them are needed.
        online: the key of each of `ONLINE_ROLES`.
        now: the time.
        attested: what it says of attestations.
    """
    root = Root(version=1, expires=_expires(now), consistent_snapshot=True)
    for signer in root_keys:
        root.add_key(signer.public_key, Root.type)
    root.roles[Root.type].threshold = threshold
    for role in ONLINE_ROLES:
        root.add_key(online[role], role)
    attested.write_to(root)
    return signed(root, root_keys)


def following_root(
    known: Metadata[Root], now: datetime, replaced: Mapping[str, Sequence[Key]], attested: Attested | None = None
) -> Metadata[Root]:
    """The root that follows one, without signatures.

    Args:
        known: the newest.
        now: the time.
        replaced: roles whose keys are replaced, and by which.
        attested: what it says of attestations; absent: the same as before.
    """
    root = deepcopy(known.signed)
    root.version += 1
    root.expires = _expires(now)
    for role, keys in replaced.items():
        for keyid in list(root.roles[role].keyids):
            root.revoke_key(keyid, role)
        for key in keys:
            root.add_key(key, role)
    if attested is not None:
        attested.write_to(root)
    return Metadata(root)


def sign_root(draft: Metadata[Root], known: Metadata[Root], signers: Sequence[Signer]) -> None:
    """Adds signatures to a root.

    Args:
        draft: the root; signatures of others stay.
        known: the one before it.
        signers: the keys.

    Raises:
        ConfigurationError: a key is none of either root.
    """
    counting = {*draft.signed.roles[Root.type].keyids, *known.signed.roles[Root.type].keyids}
    for signer in signers:
        if signer.public_key.keyid not in counting:
            raise ConfigurationError(
                f"the key {signer.public_key.keyid[:16]}… is no root key, neither before nor after; "
                f"root keys are {', '.join(sorted(keyid[:16] for keyid in counting))}"
            )
        draft.sign(signer, append=True)


def missing_signatures(draft: Metadata[Root], known: Metadata[Root]) -> int:
    """How many signatures a root still needs: as many as the one before demands, and as it demands itself."""
    return max(_missing(above, draft) for above in (known.signed, draft.signed))


def _missing(above: Root, draft: Metadata[Root]) -> int:
    result = above.get_verification_result(Root.type, draft.signed_bytes, draft.signatures)
    return max(0, result.threshold - len(result.signed))


def _expires(now: datetime) -> datetime:
    return now.replace(microsecond=0) + lifetime_of(Root.type).valid
