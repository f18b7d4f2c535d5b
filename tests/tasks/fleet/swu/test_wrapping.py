import hashlib
import shutil
import subprocess
from datetime import UTC, datetime, timedelta
from io import BytesIO
from pathlib import Path

import pytest
from helpers.required_programs import needs
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.wire.errors import BundleError, ConfigurationError, InvalidParameterException
from prefect_robomaker.tasks.fleet.swu import Release, SigningKey, describe, load_signing_key, new_signing_key, wrap

RELEASE = Release("app", "3", "/opt/app/versions/3")
NOW = datetime(2026, 11, 1, tzinfo=UTC)


@pytest.fixture(scope="module")
def key() -> SigningKey:
    """A key of its own."""
    return new_signing_key("fleet", NOW, 365, lambda count: b"\2" * count)


def wrapped(key: SigningKey, bundle: bytes) -> bytes:
    target = BytesIO()
    bundle_sha256 = wrap(BytesIO(bundle), RELEASE, key, target)
    assert bundle_sha256 == hashlib.sha256(bundle).hexdigest()
    return target.getvalue()


def files_of(archive: bytes) -> dict[str, bytes]:
    """What a cpio archive holds, by the format's description: 13 numbers of 8 digits, all in steps of 4 bytes."""
    found: dict[str, bytes] = {}
    at = 0
    while True:
        assert archive[at : at + 6] == b"070701"
        numbers = [int(archive[at + 6 + 8 * index : at + 14 + 8 * index], 16) for index in range(13)]
        size, name_size = numbers[6], numbers[11]
        name = archive[at + 110 : at + 110 + name_size]
        assert name.endswith(b"\0")
        at = -(-(at + 110 + name_size) // 4) * 4
        if name == b"TRAILER!!!\0":
            assert at == len(archive)
            return found
        found[name[:-1].decode()] = archive[at : at + size]
        at = -(-(at + size) // 4) * 4


@given(st.binary(min_size=1, max_size=200))
def test_the_archive_holds_description_signature_and_bundle_in_this_order(bundle: bytes) -> None:
    key = new_signing_key("fleet", NOW, 365, lambda count: b"\2" * count)

    archive = wrapped(key, bundle)

    files = files_of(archive)
    assert list(files) == ["sw-description", "sw-description.sig", "bundle.tar.gz"]
    assert files["bundle.tar.gz"] == bundle
    assert hashlib.sha256(bundle).hexdigest().encode() in files["sw-description"]


@needs("openssl", shutil.which("openssl"), "openssl is not installed")
@pytest.mark.parametrize("is_changed", [False, True])
def test_the_signature_is_one_for_openssl(key: SigningKey, tmp_path: Path, is_changed: bool) -> None:
    files = files_of(wrapped(key, b"content"))
    description = files["sw-description"] + (b" " if is_changed else b"")
    (tmp_path / "description").write_bytes(description)
    (tmp_path / "signature").write_bytes(files["sw-description.sig"])
    (tmp_path / "certificate").write_bytes(key.certificate_pem)

    words = "cms -verify -binary -inform DER -purpose any -no_check_time -in signature -content description"
    checked = subprocess.run(
        ["openssl", *words.split(), "-CAfile", "certificate", "-out", "out"], cwd=tmp_path, capture_output=True
    )

    assert (checked.returncode == 0) is not is_changed, checked.stderr


def test_texts_with_quotes_stay_texts() -> None:
    text = describe(Release('a"b\\', "3", '/opt/"x'), "0" * 64).decode()

    assert 'description = "a\\"b\\\\";' in text
    assert 'path = "/opt/\\"x";' in text


@pytest.mark.parametrize(
    ("release", "words"),
    [
        (Release("", "3", "/x"), "name: ''"),
        (Release("a\n", "3", "/x"), r"name: 'a\\n'"),
        (Release("a", "3" * 256, "/x"), "version: '333"),
        (Release("a", "3", "x"), "folder: 'x' is no absolute path"),
        (Release("a", "3", "/x/../y"), "folder: '/x/../y'"),
        (Release("a", "3", "/x", ()), "hardware: name at least one"),
        (Release("a", "3", "/x", ("",)), "hardware: ''"),
    ],
)
def test_texts_that_swupdate_cannot_read_are_refused(release: Release, words: str, key: SigningKey) -> None:
    with pytest.raises(InvalidParameterException, match=words):
        wrap(BytesIO(b"x"), release, key, BytesIO())


def test_an_empty_bundle_is_refused(key: SigningKey) -> None:
    with pytest.raises(BundleError, match="0 bytes"):
        wrapped(key, b"")


class Growing(BytesIO):
    """A file that is longer when it is read again."""

    def seek(self, offset: int, whence: int = 0) -> int:
        self.write(b"more")
        return super().seek(offset, whence)


def test_a_bundle_that_changes_meanwhile_is_refused(key: SigningKey) -> None:
    with pytest.raises(BundleError, match="changed while it was wrapped"):
        wrap(Growing(), RELEASE, key, BytesIO())


def test_a_key_is_read_as_it_was_written(key: SigningKey) -> None:
    again = load_signing_key(key.private_pem, key.certificate_pem)

    assert again.certificate == key.certificate
    assert again.private.private_numbers() == key.private.private_numbers()
    assert key.certificate.not_valid_after_utc - NOW == timedelta(days=365)


def test_keys_that_do_not_fit_are_refused(key: SigningKey) -> None:
    other = new_signing_key("other", NOW, 1, lambda count: b"\3" * count)

    for private, certificate, words in [
        (b"none", key.certificate_pem, "no private key in PEM"),
        (key.private_pem, b"none", "the certificate of the signing key is none in PEM"),
        (other.private_pem, key.certificate_pem, "of another key"),
    ]:
        with pytest.raises(ConfigurationError, match=words):
            load_signing_key(private, certificate)
