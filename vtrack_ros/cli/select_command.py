"""`vtrack select`: a target chosen in the browser."""

import argparse
import asyncio
from pathlib import Path
import secrets

from vtrack_ros.cli.arguments import node_name
from vtrack_ros.cli.load_ros import load_rclpy

EXAMPLES = """examples:
  vtrack select
  vtrack select /arm/tracker --port 8000
  vtrack select --host 0.0.0.0

Prints the address of a page: open it in a browser, and drag a box around the target or click on
it. With --host, other machines can open it too, with the token in the address. Ctrl-C ends it."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument('node', nargs='?', type=node_name, default='/tracker', metavar='NODE',
                        help='name of the tracking node (default: %(default)s)')
    parser.add_argument('--host', metavar='ADDRESS', help='serve on this address, protected by a '
                        'token (default: only on this machine, without a token)')
    parser.add_argument('--port', type=_port, default=8642, metavar='P',
                        help='port of the page; 0: any free one (default: %(default)s)')
    parser.add_argument('--recordings', type=Path, default=Path(), metavar='DIR',
                        help='folder for bags that are recorded on the page (default: the current '
                        'folder)')


def run(arguments: argparse.Namespace) -> int:
    """Serve the page until a signal; return 0."""
    load_rclpy('selecting')
    from vtrack_ros.selecting.server import serve
    token = '' if arguments.host is None else secrets.token_urlsafe(16)
    asyncio.run(serve(arguments.node, arguments.host or '127.0.0.1', arguments.port, token,
                      arguments.recordings))
    return 0


def _port(text: str) -> int:
    if not (text.isascii() and text.isdigit() and int(text) < 65536):
        raise argparse.ArgumentTypeError(f'must be a port from 0 to 65535, not {text!r}')
    return int(text)
