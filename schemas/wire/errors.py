"""All errors that this package raises on purpose.

```
RobomakerError
├── ServiceError                              the service's own errors; `code` is the name on the wire
│   ├── InvalidParameterException             400
│   ├── ResourceNotFoundException             400
│   ├── ResourceAlreadyExistsException        400
│   ├── IdempotentParameterMismatchException  400
│   ├── LimitExceededException                400
│   ├── ConcurrentDeploymentException         400
│   ├── ThrottlingException                   400
│   ├── InternalServerException               500
│   └── ServiceUnavailableException           503
├── SpecError                                 a specification that cannot run, with its place
├── ConfigurationError                        settings that contradict each other or lead nowhere
├── StorageError                              the object store said no
│   ├── BucketNotFoundError
│   ├── ObjectNotFoundError
│   ├── StorageAccessDeniedError
│   ├── ObjectExistsError                     a create-only write found something there
│   ├── ChecksumMismatchError
│   ├── StorageUnavailableError               it does not answer, or cannot now; the same may work later
│   │   └── StorageFullError
│   └── TransferStoppedError                  a transfer that its caller stopped
├── BundleError                               an application archive that cannot be unpacked safely
├── WorldGenerationError                      no valid world within the allowed attempts
├── AttestationError                          an attestation that is not what it has to be
├── LaunchError                               an application that cannot be started, and why
├── UnknownNameError                          a name that a mapping of results lacks; it is a KeyError, too
└── StateConflictError                        a transition that its state machine does not allow
```

`exit_code` is what the command line ends with when the error reaches it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from ..exit_codes import BAD_USAGE, BROKE


class RobomakerError(Exception):
    """Base class of all errors that this program raises on purpose."""

    exit_code = BROKE


class ServiceError(RobomakerError):
    """Base class of errors in the service's responses; class name, `code` and HTTP `status` are those of RoboMaker."""

    status = 400
    exit_code = BAD_USAGE

    @property
    def code(self) -> str:
        """Error code in the response, by which AWS SDKs choose the exception."""
        return type(self).__name__


class InvalidParameterException(ServiceError):
    """Service error: a member of the request is missing, unknown, of the wrong type or out of range."""


class ResourceNotFoundException(ServiceError):
    """Service error: the request names a resource that does not exist."""


class ResourceAlreadyExistsException(ServiceError):
    """Service error: a resource of this name exists already."""


class IdempotentParameterMismatchException(ServiceError):
    """Service error: the client token was used before with a different request."""


class LimitExceededException(ServiceError):
    """Service error: a quota is exhausted."""


class ConcurrentDeploymentException(ServiceError):
    """Service error: the fleet has another deployment in progress."""


class ThrottlingException(ServiceError):
    """Service error: too many requests at once; the same call may succeed later."""

    exit_code = BROKE


class InternalServerException(ServiceError):
    """Service error: an unexpected fault inside the service."""

    status = 500
    exit_code = BROKE


class ServiceUnavailableException(ServiceError):
    """Service error: a component that this call needs is down."""

    status = 503
    exit_code = BROKE


@dataclass(frozen=True)
class Place:
    """Position in a specification file; line and column count from 1."""

    file: str
    line: int
    column: int

    def __str__(self) -> str:
        return f"{self.file}:{self.line}:{self.column}"


@dataclass(frozen=True)
class Problem:
    """One problem in a specification: where it is, what is wrong, and what would be right."""

    place: Place
    path: str
    message: str

    def __str__(self) -> str:
        return f"{self.place}: {self.path}: {self.message}" if self.path else f"{self.place}: {self.message}"


class SpecError(RobomakerError):
    """Raised for a specification, or a single request, with one or more problems; nothing of it has been run."""

    exit_code = BAD_USAGE
    page = "docs/specification.md has the language"
    """Clause on the page that says what would be right."""

    def __init__(self, problems: list[Problem], notes: Sequence[Problem] = ()) -> None:
        self.problems = problems
        self.notes = tuple(notes)
        """Possible mistakes, in addition to the problems."""
        super().__init__("\n".join(str(problem) for problem in problems))


class ConfigurationError(RobomakerError):
    """Raised when a setting is wrong; the message names the setting and what would be right."""

    exit_code = BAD_USAGE


class CatalogAwayError(ConfigurationError):
    """Raised when the catalog's database does not answer on opening; it may be started later."""

    exit_code = BROKE


class StorageError(RobomakerError):
    """Base class of errors of the object store: it refused a call or failed."""


class BucketNotFoundError(StorageError):
    """Raised when the object store has no bucket of that name."""


class ObjectNotFoundError(StorageError):
    """Raised when the object store has no object of that key."""


class StorageAccessDeniedError(StorageError):
    """Raised when the credentials do not allow an access to the object store."""


class CredentialsRefusedError(StorageAccessDeniedError):
    """Raised when the object store does not accept the credentials at all, or a role provides none."""


class ObjectExistsError(StorageError):
    """Raised when an upload that must not overwrite finds an existing object."""


class ChecksumMismatchError(StorageError):
    """Raised when uploaded or downloaded bytes do not match their checksum."""


class StorageUnavailableError(StorageError):
    """Raised when the object store does not answer or is overloaded; the same call may succeed later.

    This is the only error of the object store for which jobs wait; all others are permanent.
    """


class StorageFullError(StorageUnavailableError):
    """Raised when there is no space left to write to; a retry may succeed after something was deleted."""


class TransferStoppedError(StorageError):
    """Raised when the caller stopped an upload or download; no partial file remains."""


class BundleError(RobomakerError):
    """Raised when an application archive is invalid, too large, or would write outside its folder."""


class WorldGenerationError(RobomakerError):
    """Raised when no valid world was generated within the allowed attempts; the message gives the last failure."""


class AttestationError(RobomakerError):
    """Raised when an attestation has a wrong signature or states something else than required."""


class LaunchError(RobomakerError):
    """Raised when an application cannot be started; `failure_code` is the simulation job's failure code.

    The code is `InvalidInput` if something in the request has to be changed.
    """

    def __init__(self, message: str, failure_code: str = "InvalidInput") -> None:
        self.failure_code = failure_code
        super().__init__(message)


class DeploymentError(RobomakerError):
    """Raised when an application cannot be deployed to robots; `failure_code` is the deployment job's failure code."""

    def __init__(self, message: str, failure_code: str) -> None:
        self.failure_code = failure_code
        super().__init__(message)


class LaunchInterruptedError(LaunchError):
    """Raised when a process that starts runs was killed during the start; a retry may succeed."""


class UnknownNameError(RobomakerError, KeyError):
    """Raised when a mapping of results has no entry of a name; the message has the names that it has."""

    # A KeyError would show its message in quotes.
    __str__ = Exception.__str__


class StateConflictError(RobomakerError):
    """Raised when an event is not allowed in the current state of a state machine."""


class LeaseLostError(StateConflictError):
    """Raised when a process was stalled or asleep so long that another process has taken over its job."""
