"""Check specifications without running anything.

Every problem is printed as file:line:column: path: message, and all of a file at once. A note is about what may be
wrong, and no problem: an application that only the catalog may know, or an archive or package that is not on this
machine. The code of archives and packages that are here is read, and not imported: functions that jobs start, and
`robot.yaml`. docs/specification.md has the language.
"""

import argparse
import json
import sys
from typing import TYPE_CHECKING, Any

from .....schemas.wire.errors import ConfigurationError, Problem, SpecError
from ...arguments import add_output, add_parameters
from ...output.answers import print_notes, print_problems

if TYPE_CHECKING:
    from .....schemas.specs.specification import CheckedSpec


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker validate` to its parser."""
    parser.add_argument(
        "specs",
        metavar="SPEC",
        nargs="+",
        help="specification, a YAML file; or one that comes along, quickstart or nightly",
    )
    add_parameters(parser)
    add_output(parser, "text", "json")


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker validate`: checks specification files and prints the problems and notes of all.

    Returns exit code 2 if any has a problem or cannot be read.
    """
    from ...inputs.specifications import InputFileError, given_parameters, read_spec

    given = given_parameters(arguments)
    answers: list[dict[str, Any]] = []
    problems: list[Problem] = []
    notes: list[Problem] = []
    for path in arguments.specs:
        try:
            spec = read_spec(path, given, is_complete=False, with_code=True)
            notes += spec.notes
            answers.append({"file": path, "valid": True, **_described(spec)})
        except SpecError as error:
            problems += error.problems
            notes += error.notes
            answers.append({"file": path, "valid": False, "problems": [_as_json(each) for each in error.problems]})
            answers[-1]["notes"] = [_as_json(each) for each in error.notes]
        except InputFileError as error:
            sys.stderr.write(f"robomaker: {error}\n")
            answers.append({"file": path, "valid": False, "problems": [{"message": str(error)}]})
    if arguments.output == "json":
        sys.stdout.write(json.dumps({"schema_version": 1, "files": answers}, indent=2) + "\n")
    else:
        for answer in answers:
            if answer["valid"]:
                sys.stdout.write(_in_a_line(answer))
        sys.stdout.flush()
        if problems:
            print_problems(problems)
        print_notes(notes)
    return 0 if all(answer["valid"] for answer in answers) else ConfigurationError.exit_code


def _described(spec: "CheckedSpec") -> dict[str, Any]:
    """Makes the JSON answer about a specification without problems: its steps, notes, jobs and missing parameters."""
    from ...planning import jobs_of_axes

    notes = [_as_json(each) for each in spec.notes]
    jobs = jobs_of_axes(spec)
    return {
        "steps": len(spec.steps),
        "problems": [],
        "notes": notes,
        **({} if jobs is None else {"jobs_of_axes": jobs}),
        **({"missing_parameters": list(spec.missing)} if spec.missing else {}),
    }


def _in_a_line(answer: dict[str, Any]) -> str:
    """Describes a file without problems: `valid, 3 steps, 12 simulation jobs; each run needs --set for arm`."""
    from .....schemas.wire.common import counted

    jobs, missing = answer.get("jobs_of_axes"), answer.get("missing_parameters")
    made = f", {counted(jobs, 'simulation job')}" if jobs is not None else ""
    needs = f"; each run needs --set for {', '.join(missing)}" if missing else ""
    return f"{answer['file']}: valid, {counted(answer['steps'], 'step')}{made}{needs}\n"


def _as_json(problem: Problem) -> dict[str, Any]:
    place = problem.place
    return {"line": place.line, "column": place.column, "path": problem.path, "message": problem.message}
