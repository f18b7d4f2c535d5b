"""Roles file: maps the role ARNs in `iamRole` to credentials and permissions of this service.

```toml
[[role]]
arn = "arn:aws:iam::000000000000:role/nightly-*"
read = ["maps/*", "applications/nav/*"]
write = ["results/nightly/*"]
profile = "nightly"
```
"""

import re
from collections.abc import Sequence
from typing import Annotated, Self

from pydantic import AfterValidator, Field, model_validator

from .wire.base import Model

ITSELF = "itself"
"""Value of `assume_role` that means the role ARN of the request itself."""

LOCAL_ROLE = "arn:aws:iam::000000000000:role/local"
"""Role ARN of jobs whose caller in Python, or whose specification, gives none; without a roles file it is only
recorded, with one it has to be in the file.
"""

BLOCK_TYPES = ("aws-credentials", "minio-credentials", "robomaker-credentials")
"""Types of Prefect blocks from which credentials are read; the first two are those of prefect-aws."""

_PLACE = re.compile(r"[a-z0-9][a-z0-9.\-]{1,61}[a-z0-9]/.+")


def _place(place: str) -> str:
    if not _PLACE.fullmatch(place) or "*" in place[:-1] or ".." in place.split("/"):
        raise ValueError(f"{place!r} is no place; bucket/*, bucket/folder/* or bucket/key would be right")
    return place


Place = Annotated[str, AfterValidator(_place)]


class Role(Model):
    """An access role: the credentials that its jobs use, and the object-store places they may read and write."""

    arn: str = Field(
        pattern=r"^arn:aws:iam::(\w+|\*):role/[^*]*\*?$",
        description="ARN of the role; one that ends with * stands for all that begin so, and * for any account.",
    )
    read: tuple[Place, ...] = Field(
        default=(), description="Objects that it may read: bucket/*, bucket/folder/*, bucket/key."
    )
    write: tuple[Place, ...] = Field(default=(), description="Objects that it may read and write.")
    access_key_id: str | None = Field(default=None, min_length=1, description="Id of its access key.")
    secret_access_key: str | None = Field(default=None, min_length=1, repr=False, description="The access key itself.")
    session_token: str | None = Field(default=None, repr=False, description="Token of a temporary access key.")
    profile: str | None = Field(default=None, min_length=1, description="Profile of the AWS configuration files.")
    block: str | None = Field(
        default=None,
        pattern=rf"^({'|'.join(BLOCK_TYPES)})/[a-z0-9-]+$",
        description="Block of Prefect with credentials, as type/name.",
    )
    assume_role: str | None = Field(
        default=None,
        pattern=rf"^({ITSELF}|arn:aws:iam::\w+:role/.+)$",
        description="ARN of the role that the S3 server's STS is asked for, or `itself`: that of the request.",
    )
    duration_s: int = Field(
        default=3600, ge=1800, le=43200, description="How long credentials of an assumed role are good for, in seconds."
    )

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        if bool(self.access_key_id) != bool(self.secret_access_key):
            raise ValueError("only one of access_key_id and secret_access_key is given; give both")
        given = [name for name in ("access_key_id", "profile", "block") if getattr(self, name)]
        if len(given) > 1:
            raise ValueError(f"{' and '.join(given)} are given; credentials come from one of them")
        if self.session_token and not self.access_key_id:
            raise ValueError("session_token belongs to an access_key_id, which is not given")
        return self

    @property
    def has_source(self) -> bool:
        """Whether the role names the source of its credentials."""
        return bool(self.access_key_id or self.profile or self.block or self.assume_role)

    def means(self, arn: str) -> bool:
        """Returns whether the role applies to the role ARN that a request names.

        The role's account may be `*`, for all, and its name may end in `*`, for all names that begin so.
        """
        account, name = account_and_name(self.arn)
        its_account, its_name = account_and_name(arn)
        if account not in ("*", its_account):
            return False
        return its_name.startswith(name[:-1]) if name.endswith("*") else its_name == name


def account_and_name(arn: str) -> tuple[str, str]:
    """Splits a role's ARN into its account and its name; an ARN of another kind gets an empty account."""
    account, found, name = arn.removeprefix("arn:aws:iam::").partition(":role/")
    return (account, name) if found and arn.startswith("arn:aws:iam::") else ("", arn)


class RolesFile(Model):
    """Content of the roles file: all access roles that simulation jobs may name."""

    role: tuple[Role, ...] = Field(default=(), description="The roles.")

    @model_validator(mode="after")
    def _different(self) -> Self:
        arns = [role.arn for role in self.role]
        if twice := sorted({arn for arn in arns if arns.count(arn) > 1}):
            raise ValueError(f"{', '.join(twice)} is there more than once; each role has one entry")
        return self


def find_role(roles: Sequence[Role], arn: str) -> Role | None:
    """Finds the role for a role ARN: by its full name, else by the longest matching prefix; `None` if none matches."""
    return max((role for role in roles if role.means(arn)), key=_closeness, default=None)


def _closeness(role: Role) -> tuple[bool, int, bool]:
    account, name = account_and_name(role.arn)
    return not name.endswith("*"), len(name), account != "*"


def is_within(places: Sequence[str], bucket: str, key: str) -> bool:
    """Whether an object, or all objects whose keys begin with `key`, are inside one of the allowed bucket places.

    A place that ends in `*` is all objects whose names begin so; another one is a single object.
    """
    name = f"{bucket}/{key}"
    return any(name.startswith(place[:-1]) if place.endswith("*") else name == place for place in places)
