"""The roles file: what is right, what is wrong with it, and that no message repeats a key."""

from pathlib import Path

import pytest

from prefect_robomaker.schemas.roles import find_role, is_within
from prefect_robomaker.schemas.wire.errors import ConfigurationError
from prefect_robomaker.tasks.storage.roles import read_roles_file
from prefect_robomaker.tasks.storage.roles.roles_file import parse_roles

ARN = "arn:aws:iam::000000000000:role/nightly"
RIGHT = f'[[role]]\narn = "{ARN}"\nread = ["maps/*"]\naccess_key_id = "AK"\nsecret_access_key = "SK"\n'


def test_a_file_that_only_its_owner_reads_is_read(tmp_path: Path) -> None:
    path = tmp_path / "roles.toml"
    path.write_text(RIGHT)
    path.chmod(0o600)

    [role] = read_roles_file(path)

    assert (role.arn, role.read, role.access_key_id) == (ARN, ("maps/*",), "AK")


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o620])
def test_a_file_that_others_may_use_is_refused(tmp_path: Path, mode: int) -> None:
    path = tmp_path / "roles.toml"
    path.write_text(RIGHT)
    path.chmod(mode)

    with pytest.raises(ConfigurationError, match=r"roles.toml.*chmod 600"):
        read_roles_file(path)


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"ROBOMAKER_ROLES_FILE is '.*nowhere'"):
        read_roles_file(tmp_path / "nowhere")


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("[[role]", "no TOML"),
        ('[[roles]]\narn = "x"', "roles is not known"),
        ('[[role]]\narn = "nightly"', r"role\[0\]\.arn"),
        (RIGHT + 'reed = ["a/*"]', r"role\[0\]\.reed is not known.*read"),
        (RIGHT + 'write = ["results"]', r"'results' is no place; bucket/\*"),
        (RIGHT + 'write = ["results/*/logs"]', "is no place"),
        (RIGHT + 'profile = "p"', "access_key_id and profile are given"),
        (RIGHT + 'block = "secret/x"', r"role\[0\]\.block"),
        (RIGHT + RIGHT, "more than once"),
        (f'[[role]]\narn = "{ARN}"\nsecret_access_key = "SK-1"', "only one of access_key_id"),
        (f'[[role]]\narn = "{ARN}"\nsecret_access_key = 12345', r"role\[0\]\.secret_access_key"),
        (f'[[role]]\narn = "{ARN}"\nduration_s = 60', r"role\[0\]\.duration_s"),
    ],
)
def test_what_is_wrong_is_named_and_no_key_is_repeated(text: str, told: str) -> None:
    with pytest.raises(ConfigurationError, match=told) as error:
        parse_roles(text, "roles.toml")

    assert "SK" not in str(error.value)
    assert "12345" not in str(error.value)


def test_the_closest_role_is_meant() -> None:
    arns = ("arn:aws:iam::1:role/*", "arn:aws:iam::1:role/night*", "arn:aws:iam::1:role/nightly")
    roles = parse_roles("\n".join(f'[[role]]\narn = "{arn}"' for arn in arns), "roles.toml")

    found = [find_role(roles, f"arn:aws:iam::1:role/{name}") for name in ("nightly", "night-2", "day")]

    assert [role and role.arn for role in found] == [arns[2], arns[1], arns[0]]
    assert find_role(roles, "arn:aws:iam::2:role/nightly") is None


def test_a_role_of_any_account_is_meant_where_no_closer_one_is() -> None:
    arns = [f"arn:aws:iam::{each}" for each in ("*:role/nightly", "*:role/team/*", "1:role/nightly", "1:role/*")]
    roles = parse_roles("\n".join(f'[[role]]\narn = "{arn}"' for arn in arns), "roles.toml")

    def meant(account: str, name: str) -> str | None:
        role = find_role(roles, f"arn:aws:iam::{account}:role/{name}")
        return role and role.arn

    assert [meant("2", "nightly"), meant("2", "team/anna"), meant("1", "team/anna")] == [arns[0], arns[1], arns[1]]
    assert [meant("1", "nightly"), meant("1", "day"), meant("2", "day")] == [arns[2], arns[3], None]
    assert find_role(roles, "arn:aws:s3:::2:role/nightly") is None


@pytest.mark.parametrize("arn", ["arn:aws:iam::*1:role/x", "arn:aws:iam::*:role/*/x", "*", "arn:aws:iam::**:role/x"])
def test_a_star_elsewhere_is_refused(arn: str) -> None:
    with pytest.raises(ConfigurationError, match=r"role\[0\]\.arn"):
        parse_roles(f'[[role]]\narn = "{arn}"', "roles.toml")


@pytest.mark.parametrize(
    ("name", "is_inside"),
    [
        ("maps/a/b", True),
        ("maps/a/", True),
        ("maps/ab", False),
        ("maps/", False),
        ("one/key", True),
        ("one/key2", False),
    ],
)
def test_places_end_where_they_say(name: str, is_inside: bool) -> None:
    bucket, _, key = name.partition("/")
    assert is_within(("maps/a/*", "one/key"), bucket, key) is is_inside
