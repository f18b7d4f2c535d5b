"""Signed `.swu` files for SWUpdate: a cpio archive of a description, its signature, and an application's archive."""

import hashlib
import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import BinaryIO

from cryptography import x509
from cryptography.exceptions import UnsupportedAlgorithm
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec, rsa
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
    load_pem_private_key,
    pkcs7,
)
from cryptography.x509.oid import NameOID

from ...schemas.wire.errors import BundleError, ConfigurationError, InvalidParameterException

_OPTIONS = [pkcs7.PKCS7Options.DetachedSignature, pkcs7.PKCS7Options.Binary]
_EARLY = timedelta(days=1)  # robots' clocks may be late
_SERIAL_BYTES = 19


@dataclass(frozen=True)
class SigningKey:
    """Private key and certificate that sign installation files for robots."""

    private: ec.EllipticCurvePrivateKey | rsa.RSAPrivateKey
    certificate: x509.Certificate

    @property
    def certificate_pem(self) -> bytes:
        """Certificate in PEM, with which robots verify signatures of installation files."""
        return self.certificate.public_bytes(Encoding.PEM)

    @property
    def private_pem(self) -> bytes:
        """The private key in PEM without a password; store it in a file that only its user can read."""
        return self.private.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())

    def sign(self, content: bytes) -> bytes:
        """Returns a detached signature of a content: CMS in DER, with SHA-256."""
        builder = pkcs7.PKCS7SignatureBuilder().set_data(content)
        return builder.add_signer(self.certificate, self.private, hashes.SHA256()).sign(Encoding.DER, _OPTIONS)


def new_signing_key(name: str, now: datetime, valid_days: int, random_bytes: Callable[[int], bytes]) -> SigningKey:
    """Creates a signing key (P-256) with a self-signed certificate.

    Robots refuse everything that an expired certificate signed, so they need the next one before.

    Args:
        name: The certificate's name, such as that of the fleet.
        now: The time, with its zone.
        valid_days: Validity of the certificate, in days.
        random_bytes: Function that returns that many random bytes, for the serial number.
    """
    private = ec.generate_private_key(ec.SECP256R1())
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
    certificate = (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(subject)
        .public_key(private.public_key())
        .serial_number(int.from_bytes(b"\1" + random_bytes(_SERIAL_BYTES)))
        .not_valid_before(now - _EARLY)
        .not_valid_after(now + timedelta(days=valid_days))
        .sign(private, hashes.SHA256())
    )
    return SigningKey(private, certificate)


def load_signing_key(private_pem: bytes, certificate_pem: bytes) -> SigningKey:
    """Reads a signing key and its certificate from PEM.

    Raises:
        ConfigurationError: The key or certificate is not valid PEM, or they do not belong together.
    """
    try:
        private = load_pem_private_key(private_pem, None)
    except (ValueError, TypeError, UnsupportedAlgorithm) as error:
        raise ConfigurationError(f"the signing key is no private key in PEM without a password: {error}") from None
    try:
        certificate = x509.load_pem_x509_certificate(certificate_pem)
    except ValueError as error:
        raise ConfigurationError(f"the certificate of the signing key is none in PEM: {error}") from None
    if not isinstance(private, ec.EllipticCurvePrivateKey | rsa.RSAPrivateKey):
        raise ConfigurationError(f"the signing key is a {type(private).__name__}; SWUpdate checks RSA and EC (P-256)")
    if certificate.public_key() != private.public_key():
        raise ConfigurationError("the certificate is that of another key than the signing key")
    return SigningKey(private, certificate)


BUNDLE = "bundle.tar.gz"
"""Name of the application's archive inside the `.swu` file."""

_TEXT = re.compile(r"[^\x00-\x1f\x7f\ud800-\udfff]{1,255}")
_PATH = re.compile(r"/[^\x00-\x1f\x7f\ud800-\udfff]{1,1023}")


@dataclass(frozen=True)
class Release:
    """Application version in a `.swu` file (SWUpdate), with its folder on the robot and hardware revisions."""

    name: str
    version: str
    folder: str
    """Absolute path on the robot of the folder that is created and into which the application is unpacked."""

    hardware: tuple[str, ...] = ("1.0",)
    """Hardware revisions on which it may be installed: the text after the colon in SWUpdate's `-H board:revision`."""


def describe(release: Release, bundle_sha256: str) -> bytes:
    """Makes the text of `sw-description`, the index file inside a `.swu` (SWUpdate) file.

    Args:
        release: Application version that is installed.
        bundle_sha256: SHA-256 of the bundle, in hexadecimal digits.

    Raises:
        InvalidParameterException: A text of the release is empty, too long, or has control characters.
    """
    if not release.hardware:
        raise InvalidParameterException("hardware: name at least one revision, such as '1.0'; robots refuse others")
    revisions = ", ".join(_quoted("hardware", revision) for revision in release.hardware)
    if not _PATH.fullmatch(release.folder) or ".." in release.folder.split("/"):
        raise InvalidParameterException(
            f"folder: {ascii(release.folder)[:100]} is no absolute path, such as '/opt/robot/versions/3', without '..'"
        )
    text = f"""software =
{{
  version = {_quoted("version", release.version)};
  description = {_quoted("name", release.name)};
  hardware-compatibility: [ {revisions} ];
  images: (
    {{
      filename = "{BUNDLE}";
      type = "archive";
      path = {_quote(release.folder)};
      properties: {{ create-destination = "true"; }};
      sha256 = "{bundle_sha256}";
    }}
  );
}}
"""
    return text.encode()


def _quoted(member: str, text: str) -> str:
    if not _TEXT.fullmatch(text):
        raise InvalidParameterException(
            f"{member}: {ascii(text)[:100]} is not right; 1 to 255 characters without control characters are"
        )
    return _quote(text)


def _quote(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


MAX_BYTES = 2**32 - 1
"""Largest length of a file in a cpio archive, in bytes: the format has 32 bits for it."""

_MAGIC = b"070701"
_PLAIN_FILE = 0o100644
_END = "TRAILER!!!"
_ALIGN = 4


def write_member(target: BinaryIO, number: int, name: str, parts: Iterable[bytes], size_bytes: int) -> None:
    """Appends a file to a cpio archive.

    Args:
        target: The archive.
        number: Number of the file in the archive, from 1.
        name: The file's name.
        parts: Content of the file, in parts.
        size_bytes: The length of all parts together.

    Raises:
        ValueError: The parts have another length.
    """
    target.write(_head(number, _PLAIN_FILE, name, size_bytes))
    written = 0
    for part in parts:
        target.write(part)
        written += len(part)
    if written != size_bytes:
        raise ValueError(f"{name} has {written} bytes and not {size_bytes}")
    target.write(bytes(-size_bytes % _ALIGN))


def write_end(target: BinaryIO) -> None:
    """Writes the end marker of a cpio archive."""
    target.write(_head(0, 0, _END, 0))


def _head(number: int, mode: int, name: str, size_bytes: int) -> bytes:
    links = 1
    fields = [number, mode, 0, 0, links, 0, size_bytes, 0, 0, 0, 0, len(name) + 1, 0]
    head = _MAGIC + b"".join(b"%08X" % field for field in fields) + name.encode("ascii") + b"\0"
    return head + bytes(-len(head) % _ALIGN)


_PART_BYTES = 1024 * 1024


def wrap(bundle: BinaryIO, release: Release, key: SigningKey, target: BinaryIO) -> str:
    """Wraps an application archive in a signed `.swu` file (SWUpdate), streaming it.

    Args:
        bundle: An archive (`.tar.gz`), open for reading, which can be rewound.
        release: Application version, and the path that it is unpacked to.
        key: Signs it.
        target: The `.swu` file, open for writing.

    Returns:
        The SHA-256 of the bundle, in hexadecimal digits.

    Raises:
        BundleError: The bundle is empty, has 4 GiB or more, or changed meanwhile.
        InvalidParameterException: A text of the release is not right.
    """
    bundle.seek(0)
    digest, size_bytes = hashlib.sha256(), 0
    for part in _parts(bundle):
        digest.update(part)
        size_bytes += len(part)
    if not 0 < size_bytes <= MAX_BYTES:
        raise BundleError(f"the bundle has {size_bytes} bytes; a .swu takes 1 to {MAX_BYTES}")
    description = describe(release, digest.hexdigest())
    signature = key.sign(description)
    for number, (name, content) in enumerate([("sw-description", description), ("sw-description.sig", signature)], 1):
        write_member(target, number, name, [content], len(content))
    bundle.seek(0)
    try:
        write_member(target, 3, BUNDLE, _parts(bundle), size_bytes)
    except ValueError as error:
        raise BundleError(f"the bundle changed while it was wrapped: {error}") from None
    write_end(target)
    return digest.hexdigest()


def _parts(bundle: BinaryIO) -> Iterator[bytes]:
    while part := bundle.read(_PART_BYTES):
        yield part
