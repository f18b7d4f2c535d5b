"""Flow classes of the operations and of pipelines: invalid calls raise errors of one sentence, as on the command line.

Prefect's own flows answer a misspelt parameter with the whole signature, and an error of the service with the
tracebacks of the engine, the task and the flow.
"""

import json
from collections.abc import Mapping
from typing import Any, Self, cast

from prefect import Flow, State
from prefect.context import FlowRunContext
from prefect.exceptions import ParameterBindError
from prefect.futures import PrefectFuture

from ..schemas.operations.registry import OPERATIONS, parse_request
from ..schemas.wire.errors import InvalidParameterException, RobomakerError
from ..schemas.wire.operation_shape import OperationShape
from .request_defaults import default_members, with_defaults

_LATER = (PrefectFuture, State)
"""Types of arguments that Prefect replaces by their results."""


class LightFlow(Flow[..., Any]):
    """Prefect flow that imports less when it is called."""

    def serialize_parameters(self, parameters: Mapping[str, Any]) -> dict[str, Any]:
        """Returns the parameters as values of JSON, as Prefect stores them; see Prefect's `Flow`.

        Prefect would import FastAPI for it, in each process that runs a flow: 0.25 s of CPU time.
        """
        try:
            return json.loads(json.dumps(parameters))
        except (
            TypeError,
            ValueError,
            RecursionError,
        ):  # futures, and what JSON does not have: Prefect knows more types
            return super().serialize_parameters(dict(parameters))


class OperationFlow(LightFlow):
    """Prefect flow that raises errors of this package without the tracebacks of Prefect's engine.

    The flow of an operation has the operation's name. An invalid request is refused before Prefect creates a flow run.
    """

    def __call__(self, *arguments: Any, return_state: bool = False, wait_for: Any = None, **members: Any) -> Any:
        """Runs the RoboMaker operation as a Prefect flow; arguments are members of the request. See Prefect's `Flow`.

        Raises:
            RobomakerError: The call is wrong, or the operation failed; the message is for people.
        """
        try:
            self._check(arguments, members, is_final=not return_state)
            call = cast("Any", super().__call__)  # pyright: ignore[reportUnknownMemberType]
            return call(*arguments, return_state=return_state, wait_for=wait_for, **members)
        except ParameterBindError as error:
            problem = InvalidParameterException(f"{self.fn.__name__}: {error.__context__ or error!s}")
        except RobomakerError as error:
            problem = error
        # The traceback leads through Prefect's engine only: the message says what a caller can do.
        raise problem.with_traceback(None) from None

    def with_options(self, **options: Any) -> Self:
        """Returns a copy of the flow with other options; see Prefect's `Flow`."""
        changed = super().with_options(**options)
        changed.__class__ = type(self)  # Prefect makes a plain one of it
        return cast("Self", changed)

    def _check(self, arguments: tuple[Any, ...], members: dict[str, Any], *, is_final: bool) -> None:
        """Raises an error for a request that is invalid by itself.

        Args:
            arguments: Positional arguments.
            members: Members of the request.
            is_final: Whether errors are raised now; otherwise they become the state of a flow run, except for misspelt
                members.
        """
        shape = OPERATIONS.get(self.fn.__name__)
        if shape is None:
            return
        if arguments:
            raise InvalidParameterException(f"{shape.name}: members are given by name, such as {_example(shape)}")
        required = {name for name, field in shape.request.model_fields.items() if field.is_required()}
        given = set(members)
        is_unbound = not given <= set(shape.request.model_fields) or not required - set(default_members(shape)) <= given
        # Prefect waits for futures; and says which call was wrong, where an operation is called in a flow.
        is_later = FlowRunContext.get() is not None or any(isinstance(each, _LATER) for each in members.values())
        if is_unbound or (is_final and not is_later):
            parse_request(shape.name, with_defaults(shape, members, bucket="any-bucket", token="any"))  # noqa: S106


def _example(shape: OperationShape) -> str:
    """Returns an example call with the names of two members, the required ones first."""
    members = sorted(shape.request.model_fields.items(), key=lambda item: not item[1].is_required())
    return f"{shape.name}({', '.join(f'{name}=…' for name, _ in members[:2])})"
