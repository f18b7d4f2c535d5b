"""Print what makes a shell complete robomaker's words with the tabulator key.

Put one line into the shell's start file:

  bash, zsh    eval "$(robomaker completion bash)"
  fish         robomaker completion fish | source

It completes commands, options, operations, ids of runs and specification files.
"""

import argparse
import sys


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker completion` to its parser."""
    parser.add_argument("shell", metavar="SHELL", choices=("bash", "zsh", "fish"), help="bash, zsh or fish")


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker completion`: prints the code for command completion in a shell."""
    from argcomplete.shell_integration import shellcode

    sys.stdout.write(shellcode(["robomaker"], shell=arguments.shell))
    return 0
