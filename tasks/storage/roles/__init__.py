"""Access roles: the object store restricted to a role's rights, and users and policies for roles on S3 servers."""

from .acting import Roles, open_roles
from .roles_file import Keys, ReadBlock, read_roles_file

__all__ = ["Keys", "ReadBlock", "Roles", "open_roles", "read_roles_file"]
