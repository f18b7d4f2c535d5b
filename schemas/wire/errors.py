"""Every error this package raises on purpose.

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
└── StateConflictError                        a transition that its state machine does not allow
```

`exit_code` is what the command line ends with when the error reaches it.
"""

from dataclasses import dataclass

from ..exit_codes import BAD_USAGE, BROKE


class RobomakerError(Exception):
    """Base of every error raised on purpose."""

    exit_code = BROKE


class ServiceError(RobomakerError):
    """An error of the service's interface; class name, `code` and `status` are those of the wire."""

    status = 400
    exit_code = BAD_USAGE

    @property
    def code(self) -> str:
        """The error's shape name, as SDKs look it up."""
        return type(self).__name__


class InvalidParameterException(ServiceError):
    """A member of the request is missing, unknown, of the wrong type or out of range."""


class ResourceNotFoundException(ServiceError):
    """The request names something that does not exist."""


class ResourceAlreadyExistsException(ServiceError):
    """The name is taken."""


class IdempotentParameterMismatchException(ServiceError):
    """The client token was used before, with another request."""


class LimitExceededException(ServiceError):
    """A quota is used up."""


class ConcurrentDeploymentException(ServiceError):
    """The fleet has a deployment under way."""


class ThrottlingException(ServiceError):
    """Too much at once, for now; the same call may succeed later."""

    exit_code = BROKE


class InternalServerException(ServiceError):
    """Something broke on this side."""

    status = 500
    exit_code = BROKE


class ServiceUnavailableException(ServiceError):
    """A part this call needs is down."""

    status = 503
    exit_code = BROKE


@dataclass(frozen=True)
class Place:
    """A place in a specification file; line and column count from 1."""

    file: str
    line: int
    column: int

    def __str__(self) -> str:
        return f"{self.file}:{self.line}:{self.column}"


@dataclass(frozen=True)
class Problem:
    """One thing wrong with a specification: where, what, and what would be right."""

    place: Place
    path: str
    message: str

    def __str__(self) -> str:
        return f"{self.place}: {self.path}: {self.message}" if self.path else f"{self.place}: {self.message}"


class SpecError(RobomakerError):
    """A specification with one or more problems; nothing of it has been run."""

    exit_code = BAD_USAGE

    def __init__(self, problems: list[Problem]) -> None:
        self.problems = problems
        super().__init__("\n".join(str(problem) for problem in problems))


class ConfigurationError(RobomakerError):
    """A setting is wrong; the message names it and what would be right."""

    exit_code = BAD_USAGE


class CatalogAwayError(ConfigurationError):
    """The catalog's database did not answer when it was to be opened; it may be started later."""

    exit_code = BROKE


class StorageError(RobomakerError):
    """The object store refused or failed."""


class BucketNotFoundError(StorageError):
    """There is no such bucket."""


class ObjectNotFoundError(StorageError):
    """There is no such object."""


class StorageAccessDeniedError(StorageError):
    """The credentials do not allow it."""


class CredentialsRefusedError(StorageAccessDeniedError):
    """The credentials are no good for anything: not known to the server, or the role gives none."""


class ObjectExistsError(StorageError):
    """A create-only write found an object in its place."""


class ChecksumMismatchError(StorageError):
    """The bytes that arrived are not the bytes that were sent."""


class StorageUnavailableError(StorageError):
    """The object store does not answer, or says that it cannot now; the same may work later.

    This is the only error of a store that jobs wait for; all others are for good.
    """


class StorageFullError(StorageUnavailableError):
    """No space left where the bytes should go; there may be, once something is removed."""


class TransferStoppedError(StorageError):
    """The caller stopped the transfer; nothing of it is left."""


class BundleError(RobomakerError):
    """An application archive is no archive, or would write outside its folder, or is too large."""


class WorldGenerationError(RobomakerError):
    """No valid world came out of the allowed number of attempts; the message says what failed last."""


class AttestationError(RobomakerError):
    """An attestation is not signed by the key it has to be signed by, or says something else than it has to."""


class LaunchError(RobomakerError):
    """An application cannot be started; `failure_code` is the simulation job's failure code.

    It is `InvalidInput` where something in the request has to be changed.
    """

    def __init__(self, message: str, failure_code: str = "InvalidInput") -> None:
        self.failure_code = failure_code
        super().__init__(message)


class DeploymentError(RobomakerError):
    """An application cannot be brought to robots; `failure_code` is the deployment job's failure code."""

    def __init__(self, message: str, failure_code: str) -> None:
        self.failure_code = failure_code
        super().__init__(message)


class LaunchInterruptedError(LaunchError):
    """Something that starts runs was killed meanwhile; trying again helps."""


class StateConflictError(RobomakerError):
    """An event arrived in a state that does not know it."""


class LeaseLostError(StateConflictError):
    """A process was held up for so long, or slept, that another one has taken over its job."""
