"""The key that signs `.swu` files, and the certificate by which robots check them (`swupdate -k`).

Robots trust the certificate itself; there is no authority above it. The update framework's keys do not protect these
robots, so this key is worth as much as the robots are.
"""

from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime, timedelta

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

from ....schemas.wire.errors import ConfigurationError

_OPTIONS = [pkcs7.PKCS7Options.DetachedSignature, pkcs7.PKCS7Options.Binary]
_EARLY = timedelta(days=1)  # robots' clocks may be late
_SERIAL_BYTES = 19


@dataclass(frozen=True)
class SigningKey:
    """A private key and its certificate."""

    private: ec.EllipticCurvePrivateKey | rsa.RSAPrivateKey
    certificate: x509.Certificate

    @property
    def certificate_pem(self) -> bytes:
        """The certificate, for robots."""
        return self.certificate.public_bytes(Encoding.PEM)

    @property
    def private_pem(self) -> bytes:
        """The private key, without a password; it belongs into a file that only its user reads."""
        return self.private.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())

    def sign(self, content: bytes) -> bytes:
        """A detached signature of a content: CMS in DER, with SHA-256."""
        builder = pkcs7.PKCS7SignatureBuilder().set_data(content)
        return builder.add_signer(self.certificate, self.private, hashes.SHA256()).sign(Encoding.DER, _OPTIONS)


def new_signing_key(name: str, now: datetime, valid_days: int, random_bytes: Callable[[int], bytes]) -> SigningKey:
    """Makes a key (P-256) and a certificate that it signs itself.

    Robots refuse everything that an expired certificate signed, so they need the next one before.

    Args:
        name: the certificate's name, such as that of the fleet.
        now: the time, with its zone.
        valid_days: how long the certificate is valid.
        random_bytes: gives that many random bytes, for the serial number.
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
    """Reads a key and its certificate.

    Raises:
        ConfigurationError: one of them is none, or they do not belong together.
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
