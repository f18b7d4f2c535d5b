"""`sw-description`: what SWUpdate does with the files of a `.swu`, as text in libconfig's format."""

import re
from dataclasses import dataclass

from ....schemas.wire.errors import InvalidParameterException

BUNDLE = "bundle.tar.gz"
"""Name of the bundle in the archive."""

_TEXT = re.compile(r"[^\x00-\x1f\x7f\ud800-\udfff]{1,255}")
_PATH = re.compile(r"/[^\x00-\x1f\x7f\ud800-\udfff]{1,1023}")


@dataclass(frozen=True)
class Release:
    """Application version in a `.swu`, its folder on the robot, and the hardware revisions that it is for."""

    name: str
    version: str
    folder: str
    """Absolute path on the robot; it is made, and the bundle is unpacked there."""

    hardware: tuple[str, ...] = ("1.0",)
    """Revisions of the hardware that it is for: what follows the colon in SWUpdate's `-H board:revision`."""


def describe(release: Release, bundle_sha256: str) -> bytes:
    """The text of `sw-description`.

    Args:
        release: what is installed.
        bundle_sha256: SHA-256 of the bundle, in hexadecimal digits.

    Raises:
        InvalidParameterException: a text of the release is empty, too long, or has control characters.
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
