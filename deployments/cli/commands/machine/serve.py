"""Answer SDKs and the AWS CLI, and carry out the jobs they ask for.

Prints what to set so that clients find it. Access keys: ROBOMAKER_ACCESS_KEYS_FILE (docs/serving.md).
"""

import argparse

from ...arguments import add_open, add_output


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker serve` to its parser."""
    parser.add_argument("--host", default="127.0.0.1", help="address to listen at (default: 127.0.0.1)")
    parser.add_argument("--port", type=int, default=8057, help="port to listen at; 0: any (default: 8057)")
    parser.add_argument(
        "--tls-certificate", metavar="FILE", help="PEM file with a certificate chain: answer over HTTPS"
    )
    parser.add_argument("--tls-key", metavar="FILE", help="PEM file with the certificate's private key")
    parser.add_argument(
        "--execute",
        dest="execute_jobs",
        choices=("here", "none"),
        default="here",
        help="who carries jobs out: this program, or another one (default: here); batches also use ROBOMAKER_BACKEND",
    )
    parser.add_argument(
        "--max-jobs",
        type=int,
        metavar="N",
        help="simulation jobs at once, those of batches too (default: number of CPUs)",
    )
    parser.add_argument("--log-requests", action="store_true", help="write a line for each request to standard error")
    parser.add_argument("--audit-log", metavar="FILE", help="add a line of JSON for each call: who, what, how it ended")
    add_output(parser, "text", "json")
    add_open(parser, "show the console in a browser, once it answers")


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker serve`: serves the API and web console until a signal stops it."""
    from ...server_and_worker import serve

    return serve(arguments)
