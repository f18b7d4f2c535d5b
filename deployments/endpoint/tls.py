"""The certificate with which the endpoint answers over HTTPS."""

import ssl
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from ...schemas.wire.errors import ConfigurationError


@dataclass(frozen=True)
class TlsFiles:
    """A certificate chain and its private key, both as PEM."""

    certificate: Path
    key: Path

    @classmethod
    def checked(cls, certificate: str | None, key: str | None) -> Self | None:
        """The files, once a server could use them; `None`: neither is given.

        Raises:
            ConfigurationError: one is not given, cannot be read or used, or they do not belong together.
        """
        if certificate is None and key is None:
            return None
        if certificate is None or key is None:
            given, missing = ("key", "certificate") if certificate is None else ("certificate", "key")
            raise ConfigurationError(f"--tls-{given} is given, and --tls-{missing} is not; HTTPS needs both")
        files = cls(Path(certificate), Path(key))
        for option, path in (("--tls-certificate", files.certificate), ("--tls-key", files.key)):
            try:
                path.read_bytes()
            except OSError as error:
                raise ConfigurationError(f"{option} {path}: {error.strerror}") from error
        files._check()
        return files

    def _check(self) -> None:
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        try:
            # Without this answer a key that has a password would be asked for at the terminal.
            context.load_cert_chain(self.certificate, self.key, password=lambda: "")
        except ssl.SSLError as error:
            if error.reason == "KEY_VALUES_MISMATCH":
                raise ConfigurationError(f"--tls-key {self.key} is not the key of {self.certificate}") from error
            raise ConfigurationError(
                f"--tls-certificate {self.certificate} and --tls-key {self.key} have to be PEM files, "
                f"the key without a password: {error.reason or error}"
            ) from error
