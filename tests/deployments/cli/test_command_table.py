"""The table of commands, and that their modules keep to what it counts on."""

import argparse
import importlib
import inspect
import re
import subprocess
import sys

import pytest

from prefect_robomaker.deployments.cli.grammar import Command, build_parser, find_commands, find_groups


def every_command() -> list[Command]:
    return [each for group in find_groups() for top in group.commands for each in below(top)]


def below(command: Command) -> list[Command]:
    """The commands of a folder, also of folders in it; otherwise the command itself."""
    return (
        [each for inner in find_commands(command.path, command.module) for each in below(inner)]
        if command.path.is_dir()
        else [command]
    )


@pytest.mark.parametrize("command", every_command(), ids=lambda command: command.path.stem)
def test_a_commands_module_has_help_arguments_and_what_it_does(command: Command) -> None:
    module = command.load()
    assert command.description == inspect.getdoc(module)
    assert command.summary[0].islower()
    assert not command.summary.endswith(".")
    parser = argparse.ArgumentParser()
    module.declare(parser)
    assert module.execute.__doc__


def test_a_module_that_is_put_there_is_a_command(robomaker, monkeypatch, tmp_path) -> None:
    group = tmp_path / "commands" / "greetings"
    group.mkdir(parents=True)
    (group / "__init__.py").write_text('"""Greet robots."""\n')
    (group / "wave_back.py").write_text(
        '"""Wave back.\n\nTo one robot.\n"""\n\ndef declare(parser): parser.add_argument("robot")\n\n\n'
        "def execute(arguments):\n    print(f'o/ {arguments.robot}')\n    return 5\n"
    )
    package = "prefect_robomaker.deployments.cli"
    monkeypatch.setattr(f"{package}.grammar.COMMANDS", tmp_path / "commands")
    commands = importlib.import_module(f"{package}.commands")
    monkeypatch.setattr(commands, "__path__", [str(tmp_path / "commands")])

    assert re.search(r"^  Greet robots:\n    wave-back +wave back$", build_parser().format_help(), re.MULTILINE)
    waved = robomaker("wave-back", "scout")
    assert (waved.code, waved.out) == (5, "o/ scout\n")
    assert "Wave back.\n\nTo one robot." in robomaker("wave-back", "--help").out


def test_help_imports_no_command_and_a_command_only_itself() -> None:
    code = "import sys; from prefect_robomaker.deployments.cli.main import main\ntry: main(sys.argv[1:])\n"
    code += "except SystemExit: pass\nprint(*(n for n in sys.modules if '.commands.' in n), file=sys.stderr)"
    for words, expected in (
        (["--help"], []),
        (["plan", "--help"], ["specifications", "plan"]),
        (["world", "--help"], []),
    ):
        ended = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True, check=True)
        assert [name.rpartition(".")[2] for name in ended.stderr.split()] == expected
