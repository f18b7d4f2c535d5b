"""OpenTelemetry spans of requests, jobs and their steps.

They use only OpenTelemetry's API package, so they cost microseconds and are discarded unless the program is started
with an SDK, by `opentelemetry-instrument` for example.
"""

from collections.abc import Generator
from contextlib import contextmanager
from contextvars import ContextVar

from opentelemetry import trace
from opentelemetry.propagate import extract

_TRACER = trace.get_tracer("prefect_robomaker")
_ARN: ContextVar[str | None] = ContextVar("robomaker_arn", default=None)

Value = str | int | float | bool


@contextmanager
def span(
    name: str, *, arn: str | None = None, traceparent: str | None = None, **attributes: Value
) -> Generator[trace.Span]:
    """Opens an OpenTelemetry span inside the `with` block; an exception is recorded as its error.

    Args:
        name: Name of the activity.
        arn: ARN of the job that the span is about; spans inside the block get it, too.
        traceparent: The caller's span, from the `traceparent` header of its request.
        **attributes: Further attributes, whose names get `robomaker.` in front.
    """
    about = arn or _ARN.get()
    named = {f"robomaker.{key}": value for key, value in ({"arn": about} if about else {}).items() | attributes.items()}
    token = _ARN.set(about)
    try:
        context = extract({"traceparent": traceparent}) if traceparent else None
        with _TRACER.start_as_current_span(name, context, attributes=named) as current:
            yield current
    finally:
        _ARN.reset(token)
