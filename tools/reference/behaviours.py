"""All that is to be known of operations besides their shapes: differences, decisions, what is missing.

Beside `differences`, which tests compare with the published model, this is what tests of the flows show;
the documentation is made from both.
"""

from collections.abc import Mapping

from .behaviour import Behaviour, decided, differs
from .behaviours_applications import APPLICATIONS, FLEETS, TAGS
from .behaviours_simulations import SIMULATIONS
from .behaviours_worlds import WORLDS

EVERYWHERE = (
    differs(
        "Retention",
        "",
        known="Simulation and deployment jobs disappeared after 90 days.",
        here="Nothing disappears by itself.",
    ),
    differs(
        "Quotas",
        "",
        known="So many jobs, batches, robots and fleets per account, then `LimitExceededException`.",
        here="40 versions and 50 tags, as before; jobs beyond what the machine takes wait as `Pending`.",
    ),
    decided(
        "What was refused at the end",
        "",
        known="The service refused bundles, worlds in jobs and usual tools, while samples went on using them.",
        here="All of it is accepted, unless `ROBOMAKER_REFUSE_DEPRECATED` is 1.",
    ),
    decided(
        "Ids",
        "",
        known="Examples of some kinds only.",
        here="The kind and 12 letters and digits: `template-…`, `generation-…`, `export-…`, `sim-…`, `batch-…`. A "
        "world is `<id of its generation job>/world-<n>`.",
    ),
    decided(
        "How long tokens hold",
        "",
        known="Not found.",
        here="As long as the resource that they made.",
    ),
    decided(
        "Filters",
        "",
        known="Up to three according to the text, one according to the model.",
        here="One filter with one value, compared whole. Names that a list does not know are refused.",
    ),
    decided(
        "Pages",
        "",
        known="Order and life of page tokens were not documented.",
        here="Newest first; a token is good for its operation and filters, and what is added or deleted meanwhile "
        "makes no entry come twice or be left out.",
    ),
    decided(
        "Patterns",
        "",
        known="The model's are not anchored.",
        here="They have to match the whole value. No text may hold the character U+0000.",
    ),
    decided(
        "Times",
        "",
        known="The text says milliseconds, SDKs read seconds.",
        here="Seconds since 1970, as JSON numbers.",
    ),
    decided(
        "Members that are not known",
        "",
        known="Not documented.",
        here="`InvalidParameterException`, with the nearest name. A member that is `null` is absent.",
    ),
    decided(
        "ARNs of nothing",
        "",
        known="Every text with `arn:` in it fits the model.",
        here="`ResourceNotFoundException`; `InvalidParameterException` where the form is looked at, and wrong.",
    ),
    differs(
        "Throttling",
        "",
        known="`ThrottlingException` also meant that operations had ended.",
        here="Only that there is too much to do for the moment; SDKs try again.",
    ),
)

BEHAVIOURS: Mapping[str, tuple[Behaviour, ...]] = {
    "All operations": EVERYWHERE,
    "Worlds": WORLDS,
    "Applications": APPLICATIONS,
    "Simulation jobs and batches": SIMULATIONS,
    "Fleets, robots and deployments": FLEETS,
    "Tags": TAGS,
}
"""Behaviours by their subjects."""


def behaviours_of(operation: str) -> tuple[Behaviour, ...]:
    """Lists the known behaviours of one operation, without those that hold for all operations."""
    return tuple(each for group in BEHAVIOURS.values() for each in group if operation in each.operations)
