"""Specifications that will run again without anybody's doing: those of deployments, and of runs that have not ended.

What they name stays, by ARN, id or name: otherwise the next night fails, or its names mean other worlds.
"""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ...schemas.reports.run_record import Order
from ...schemas.specs.check import load_spec
from ...schemas.specs.yaml_nodes import parse, plain
from ...schemas.wire.errors import ConfigurationError, InvalidParameterException, RobomakerError
from ..inspection.run_records import ORDER_NAME
from ..service.references import worlds_meant
from ..service.service import Service
from .inventory import texts_in, with_jobs_of

PIPELINE = "RunPipeline"
"""Flow that runs a specification; the flows of operations have requests as parameters."""

_ARN = re.compile(r"arn:[^\s\"'\\,\]}]+")


@dataclass(frozen=True)
class StoredSpecification:
    """A specification, or an operation's request, that runs again later."""

    holder: str
    """Holder of the specification in words: `the deployment RunPipeline/nightly`."""
    parameters: Mapping[str, Any]
    """Parameters of its flow: `text` or `spec`, and values of the specification's parameters."""
    is_pipeline: bool = True
    """Whether its flow runs a specification."""
    worlds: Mapping[str, str] = field(default_factory=dict[str, str])
    """ARNs of the worlds that were found before, by name: these names are not looked up again."""

    @property
    def text(self) -> str:
        """Text of the specification; empty: its flow has a request instead.

        Raises:
            OSError: It is a file that cannot be read here.
        """
        if not self.is_pipeline:
            return ""
        path = self.parameters.get("spec")
        return Path(str(path)).read_text(encoding="utf-8") if path else str(self.parameters.get("text") or "")


@dataclass(frozen=True)
class Named:
    """Everything that stored specifications name."""

    holders: Mapping[str, str]
    """Holder of each resource, in words, by the resource's ARN."""
    texts: Set[str]
    """All texts of the specifications, for keys of objects."""
    unreadable: Sequence[str]
    """Reasons why some specifications may name more than is known; empty: all could be read."""


def stored_orders(service: Service, besides: Set[str]) -> Iterator[StoredSpecification | str]:
    """Yields the specifications of runs that have not ended, or why one cannot be read.

    Args:
        service: The service, with its data home.
        besides: Ids of runs that do not count, since they go.
    """
    for path in sorted((service.settings.home / "runs").glob(f"*/{ORDER_NAME}")):
        run_id = path.parent.name
        if run_id in besides:
            continue
        try:
            order = Order.model_validate_json(path.read_bytes())
        except FileNotFoundError:  # it has just ended
            continue
        except (ValueError, OSError) as error:
            yield f"the order of the run {run_id} cannot be read ({type(error).__name__})"
            continue
        parameters = {"text": order.text, "origin": order.filename, **order.parameters}
        yield StoredSpecification(f"the run {run_id}, which has not ended,", parameters, worlds=order.worlds)


def named_in(specifications: Iterable[StoredSpecification | str], service: Service) -> Named:
    """Finds everything that stored specifications name; of a name that means several worlds all of them.

    Args:
        specifications: The specifications; a text says why one is not known.
        service: The service, with its catalog.
    """
    holders: dict[str, str] = {}
    texts: set[str] = set()
    unreadable: list[str] = []
    for each in specifications:
        if isinstance(each, str):
            unreadable.append(each)
            continue
        try:
            arns, own = _names_of(each, service)
        except (RobomakerError, OSError, ValueError) as error:
            unreadable.append(f"the specification of {each.holder.rstrip(',')} cannot be read ({_first_line(error)})")
            continue
        texts |= own
        for arn in arns:
            holders.setdefault(arn, each.holder)
    return Named(with_jobs_of(holders, service) | holders, texts, unreadable)


def _names_of(stored: StoredSpecification, service: Service) -> tuple[set[str], set[str]]:
    """Returns the ARNs that a specification or request names, and all of its texts."""
    text = stored.text
    origin = str(stored.parameters.get("origin") or "specification")
    given = {name: value for name, value in stored.parameters.items() if name not in ("text", "spec", "origin")}
    content = plain(parse(text, origin)) if text else {}
    texts = {*texts_in(content), *texts_in(given)}
    arns = {arn for each in texts for arn in _ARN.findall(each)} | set(stored.worlds.values())
    for name in _names_of_worlds(text, origin, given) if text else ():
        if name not in stored.worlds:
            arns |= {world.arn for world in _worlds(name, service)}
    return arns, texts


def _names_of_worlds(text: str, origin: str, given: Mapping[str, Any]) -> set[str]:
    """Returns the names of worlds in a specification, also those that its parameters may be given."""
    declared = load_spec(text, origin, is_complete=False).declared
    # A flow has parameters besides: reuse, continues, or the whole of them as one.
    spec = load_spec(text, origin, {name: given[name] for name in declared if name in given}, is_complete=False)
    choices = {choice for each in spec.declared.values() for choice in each.choices or () if isinstance(choice, str)}
    return {each.name for step in spec.steps.values() for each in step.worlds} | choices


def _worlds(name: str, service: Service) -> list[Any]:
    try:
        return worlds_meant(name, service)
    except (ConfigurationError, InvalidParameterException):
        return []


def _first_line(error: Exception) -> str:
    return str(error).partition("\n")[0] or type(error).__name__
