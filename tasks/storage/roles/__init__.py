"""Roles: the object store as the role that a request names has it, and the roles' users and policies on S3 servers."""

from .acting import Roles, open_roles
from .roles_file import Keys, ReadBlock, read_roles_file

__all__ = ["Keys", "ReadBlock", "Roles", "open_roles", "read_roles_file"]
