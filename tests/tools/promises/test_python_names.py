"""Facts of Python names: what callers can give, and what they get."""

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, Literal, cast

from tools.promises.facts import Fact, breaks
from tools.promises.python_names import facts_of_names


@dataclass(frozen=True)
class Options:
    name: str
    count: int = 3

    @property
    def outcome(self) -> Literal["good", "bad"] | None:
        """One of three."""
        return None

    def open(self, path: str, /, *, mode: Literal["r", "w"] = "r") -> bytes:
        """Opens it."""
        return f"{path}{mode}".encode()

    def _own(self) -> None: ...


class LostError(Exception):
    pass


def function(text: str, *more: int, **others: Any) -> Options | None: ...


def facts(**names: object) -> dict[str, Fact]:
    module = SimpleNamespace(**names, __all__=list(names), __name__=__name__)
    return facts_of_names(cast("Any", module), ())


def types(*names: str) -> frozenset[str]:
    return frozenset(names)


def test_classes_have_what_they_are_made_with_and_their_members() -> None:
    found = facts(Options=Options)

    assert found == {
        "Options": Fact(form="class"),
        "Options.(name)": Fact(taken=types("str"), required=True, place=0),
        "Options.(count)": Fact(taken=types("int"), default="3", place=1),
        "Options.name": Fact(given=types("str"), required=True),
        "Options.count": Fact(given=types("int"), required=True),
        "Options.outcome": Fact(given=types('"good"', '"bad"', "NoneType"), required=True),
        "Options.open": Fact(form="method", given=types("bytes")),
        "Options.open.(path)": Fact(form="by place only", taken=types("str"), required=True, place=1),
        "Options.open.(mode)": Fact(taken=types('"r"', '"w"'), default="'r'"),
    }


def test_functions_have_parameters_and_a_result() -> None:
    assert facts(function=function) == {
        "function": Fact(form="function", given=types("Options", "NoneType")),
        "function.(text)": Fact(taken=types("str"), required=True, place=0),
        "function.(more)": Fact(form="any number", taken=types("int")),
        "function.(others)": Fact(form="any names", taken=types("Any")),
    }


def test_errors_stay_what_callers_catch() -> None:
    class Renamed(ValueError): ...

    assert breaks(facts(LostError=LostError), facts(LostError=LostError)) == []
    (problem,) = breaks(facts(LostError=Renamed), facts(LostError=LostError))
    assert problem.startswith("LostError is ValueError is gone")
