"""Arguments that several commands have, declared once so that they are called and explained the same everywhere."""

import argparse
from math import isfinite


def add_output(parser: argparse.ArgumentParser, *forms: str) -> None:
    """Adds the option `--output` (form of a command's output) to a command's parser; the first form is the default."""
    parser.add_argument(
        "-o", "--output", choices=forms, default=forms[0], help=f"form of the answer (default: {forms[0]})"
    )


def add_open(parser: argparse.ArgumentParser, text: str) -> None:
    """Adds the options `--open` and `--no-open` (show the result in a browser) to a command's parser."""
    parser.add_argument("--open", action=argparse.BooleanOptionalAction, default=None, help=text)


def add_report(parser: argparse.ArgumentParser) -> None:
    """Adds the options of commands that write an HTML report: `--report` for a copy of it, `--output`, `--open`."""
    parser.add_argument("--report", metavar="PATH", help="put a copy of the report there")
    add_output(parser, "text", "json")
    add_open(parser, "show the report in a browser (by default only on a desktop's terminal)")


def add_backend(parser: argparse.ArgumentParser) -> None:
    """Adds the option `--backend` (where jobs of batches run) to a command's parser."""
    from ...schemas.backends import BACKENDS_IN_WORDS

    text = f"where jobs of batches run, in place of ROBOMAKER_BACKEND: {BACKENDS_IN_WORDS}"
    parser.add_argument("--backend", metavar="B", help=text)


def add_spec(parser: argparse.ArgumentParser) -> None:
    """Adds the argument for a specification's file to a command's parser."""
    parser.add_argument(
        "spec", metavar="SPEC", help="specification, a YAML file; or one that comes along, quickstart or nightly"
    )


def add_parameters(parser: argparse.ArgumentParser) -> None:
    """Adds the options `--set` and `--parameters` (values of a specification's parameters) to a command's parser."""
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="value of a parameter of SPEC; may be given again, and overrides --parameters",
    )
    parser.add_argument("--parameters", metavar="FILE", help="values of parameters of SPEC: a YAML file, name: value")


def add_world(parser: argparse.ArgumentParser) -> None:
    """Adds the argument for a world (its ARN, id or folder) to a command's parser."""
    parser.add_argument(
        "world", metavar="WORLD", help="world: name (`flat 3`), id or its beginning, ARN, or folder of its bundle"
    )


def add_simulation(parser: argparse.ArgumentParser) -> None:
    """Adds the argument for a simulation job that is to be run again to a command's parser."""
    text = (
        "simulation job: name (`scout in flat 3`, `latest/scout in flat 3`), id or its beginning, ARN; or "
        "s3://BUCKET/PREFIX or a folder of outputs"
    )
    parser.add_argument("run", metavar="JOB", help=text)
    trial = "number of the trial, of a job that has trials (default: the first one that did not pass, else 0)"
    parser.add_argument("--trial", metavar="K", type=_trial_number, help=trial)


def given_options(arguments: argparse.Namespace, *names: str) -> list[str]:
    """Returns options as words of a command line, as they were given.

    Args:
        arguments: Parsed arguments of a command.
        names: Options with one or several values, as Python names; those that were not given are left out.
    """
    values = {name: getattr(arguments, name) for name in names}
    several = {name: value if isinstance(value, list) else [value] for name, value in values.items()}
    return [
        word
        for name, each in several.items()
        for one in each
        if one is not None
        for word in (f"--{name.replace('_', '-')}", str(one))
    ]


def finite_numbers(text: str, *counts: int) -> list[float] | None:
    """Reads finite numbers with commas between them, as many as one of the counts; `None`: it is something else."""
    try:
        numbers = [float(each) for each in text.split(",")]
    except ValueError:
        return None
    return numbers if len(numbers) in counts and all(map(isfinite, numbers)) else None


def _trial_number(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text!r} is no trial; its number, from 0, would be right")
    return int(text)
