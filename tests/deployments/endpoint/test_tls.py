"""HTTPS by two options, as boto3 sees it."""

import datetime
import ipaddress
from collections.abc import Callable
from pathlib import Path
from typing import Any

import boto3
import pytest
from botocore.config import Config
from botocore.exceptions import SSLError
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from helpers.endpoint_here import ServeHere

from prefect_robomaker.deployments.endpoint.server import TlsFiles
from prefect_robomaker.deployments.service_model.installation import data_path
from prefect_robomaker.schemas.wire.errors import ConfigurationError

PEM = serialization.Encoding.PEM
Files = tuple[str, str]


def make_certificate(folder: Path, name: str = "server", password: bytes | None = None) -> Files:
    """A certificate for 127.0.0.1 that signs itself, and its key."""
    key = ec.generate_private_key(ec.SECP256R1())
    subject = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, name)])
    now = datetime.datetime.now(datetime.UTC)
    address = x509.SubjectAlternativeName([x509.IPAddress(ipaddress.ip_address("127.0.0.1"))])
    certificate = (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(subject)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - datetime.timedelta(hours=1))
        .not_valid_after(now + datetime.timedelta(days=1))
        .add_extension(address, critical=False)
    )
    encryption = serialization.BestAvailableEncryption(password) if password else serialization.NoEncryption()
    files = folder / f"{name}.pem", folder / f"{name}-key.pem"
    files[0].write_bytes(certificate.sign(key, hashes.SHA256()).public_bytes(PEM))
    files[1].write_bytes(key.private_bytes(PEM, serialization.PrivateFormat.PKCS8, encryption))
    return str(files[0]), str(files[1])


def test_boto3_calls_over_https(serve_here: ServeHere, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    certificate, key = make_certificate(tmp_path)
    monkeypatch.setenv("AWS_DATA_PATH", data_path({}))
    with serve_here("--tls-certificate", certificate, "--tls-key", key) as served:
        assert served.url.startswith("https://127.0.0.1:")
        assert served.facts["environment"]["AWS_ENDPOINT_URL_ROBOMAKER"] == served.url

        def list_fleets(verify: str | None) -> object:
            make: Any = boto3.client  # whose types do not know the service any more
            client = make(
                "robomaker",
                endpoint_url=served.url,
                region_name="us-east-1",
                aws_access_key_id="local",
                aws_secret_access_key="local",
                verify=verify,
                config=Config(retries={"total_max_attempts": 1}),
            )
            return client.list_fleets()["fleetDetails"]

        assert list_fleets(certificate) == []
        with pytest.raises(SSLError, match="certificate verify failed"):
            list_fleets(None)
    assert "Traceback" not in served.log.read_text()


def test_without_options_there_is_no_tls() -> None:
    assert TlsFiles.checked(None, None) is None


def test_files_that_belong_together_are_taken(tmp_path: Path) -> None:
    certificate, key = make_certificate(tmp_path)
    assert TlsFiles.checked(certificate, key) == TlsFiles(Path(certificate), Path(key))


@pytest.mark.parametrize(
    ("choose", "expected"),
    [
        (lambda one, _: (one[0], None), "--tls-certificate is given, and --tls-key is not; HTTPS needs both"),
        (lambda one, _: (None, one[1]), "--tls-key is given, and --tls-certificate is not"),
        (lambda one, _: (one[0], "nothing.pem"), "--tls-key nothing.pem: No such file or directory"),
        (lambda one, other: (one[0], other[1]), "other-key.pem is not the key of "),
        (lambda one, _: (one[1], one[1]), "have to be PEM files"),
        (lambda one, _: (one[0], one[0]), "have to be PEM files, the key without a password"),
    ],
)
def test_what_is_wrong_with_the_files_is_told(tmp_path: Path, choose: Callable[..., Any], expected: str) -> None:
    files = choose(make_certificate(tmp_path, "one"), make_certificate(tmp_path, "other"))
    with pytest.raises(ConfigurationError, match=expected):
        TlsFiles.checked(*files)


def test_a_key_with_a_password_is_refused_and_not_asked_for(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="the key without a password"):
        TlsFiles.checked(*make_certificate(tmp_path, password=b"secret"))
