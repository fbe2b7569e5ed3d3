"""
The command line `vtrack`.

A subcommand is a module with `add_arguments(parser)`, `run(arguments) -> int` and `EXAMPLES`; a
line in `_COMMANDS` registers it. It's imported only when it's called.
"""

import argparse
from collections.abc import Sequence
from difflib import get_close_matches
from importlib import import_module
import io
import os
import re
import sys
from typing import NoReturn

from vtrack_ros import __version__
from vtrack_ros.dds import end_process

_INTERRUPTED = 130
_PIPE_CLOSED = 141
#: Module -> its packages of pip and, after python3-, of apt, if they have another name.
_PACKAGES = {'cv2': ('opencv-python-headless', 'opencv')}
_COMMANDS = {
    'synth': 'render a synthetic scene with exact ground truth into a bag',
    'import': 'convert images or a video to a bag',
    'play': 'publish the messages of a bag, like ros2 bag play',
    'replay': 'run a tracker on a bag, without a node',
    'evaluate': 'compare trackers on bags and image folders with ground truth',
    'doctor': 'check the installation and the image topics, and suggest remedies',
    'layout': 'print a layout for RViz or Foxglove with the topics of a node',
    'select': 'select the target in the browser, and watch the tracking',
}


class Parser(argparse.ArgumentParser):
    """A parser that reports an error in one line."""

    def error(self, message: str) -> NoReturn:
        """Print the message and exit with 2."""
        complain(self.prog, message)
        sys.exit(2)


def main(argv: Sequence[str] | None = None) -> int:
    """
    Run a command line.

    Returns 0, or 1 if something failed, 2 if the arguments or the input are wrong, 130 after
    Ctrl-C, 141 if standard output was closed.
    """
    words = list(sys.argv[1:] if argv is None else argv)
    if isinstance(sys.stdout, io.TextIOWrapper):
        # as on standard error: a file's name may have bytes that the terminal's encoding lacks
        sys.stdout.reconfigure(errors='backslashreplace')
    # As in the node: on a busy machine, threads that wait for one another take far longer.
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    if '_ARGCOMPLETE' in os.environ:
        # print the completions of a line for the shell, and exit
        import argcomplete
        argcomplete.autocomplete(command_parser(
            ''.join(os.environ.get('COMP_LINE', '').split()[1:2])))
    try:
        code = _run(words)
        sys.stdout.flush()
    except SystemExit as stop:
        code = int(stop.code or 0)
    except KeyboardInterrupt:
        code = _INTERRUPTED
    except BrokenPipeError:
        # Discard what's still in the buffer, so that Python doesn't try to write it at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = _PIPE_CLOSED
    return end_process(code)


def _run(words: list[str]) -> int:
    listed = 'valid are ' + ', '.join(_COMMANDS)
    if not words:
        return complain('vtrack', f'no command given; {listed}')
    name = words[0]
    if name not in (*_COMMANDS, '-h', '--help', 'help', '--version'):
        near = get_close_matches(name, _COMMANDS, 1)
        hint = f'did you mean {near[0]}?' if near else listed
        return complain('vtrack', f'unknown command {name!r}; {hint}')
    prog = f'vtrack {name}'
    try:
        arguments = command_parser(name).parse_args(
            ['--help'] if name == 'help' else negative_values(words))
        return int(arguments.run(arguments))
    except ModuleNotFoundError as error:
        package = (error.name or '').partition('.')[0]
        if package == 'vtrack_ros':
            raise
        complain(prog, str(error) if 'install' in str(error) else
                 f'{error}; install it: {_installation(package)}')
        return 1
    except (TypeError, ValueError) as error:
        return complain(prog, str(error))
    except BrokenPipeError:
        raise
    except OSError as error:
        complain(prog, os_error_text(error))
        return 1
    except RuntimeError as error:
        if not is_of_ros(error):
            raise
        complain(prog, str(error))
        return 1


def command_parser(called: str) -> Parser:
    """Return a parser with the names of all commands, and the arguments of the called one."""
    parser = Parser('vtrack', description='Make and play bags of images, and track a '
                    'target in them.', epilog='vtrack COMMAND --help shows the options and '
                    'examples.')
    parser.add_argument('--version', action='version', version=f'vtrack {__version__}')
    commands = parser.add_subparsers(title='commands', metavar='COMMAND', required=True)
    for name, summary in _COMMANDS.items():
        command = commands.add_parser(
            name, help=summary, description=summary[0].upper() + summary[1:] + '.',
            formatter_class=argparse.RawDescriptionHelpFormatter)
        if name == called:
            module = import_module(f'vtrack_ros.cli.{name}_command')
            module.add_arguments(command)
            command.epilog = module.EXAMPLES
            command.set_defaults(run=module.run)
    return parser


def negative_values(words: Sequence[str]) -> list[str]:
    """Return a command line in which `--init -10,2,30,30` is `--init=-10,2,30,30`."""
    # argparse takes a word that begins with - for an option, unless it's a plain number.
    joined: list[str] = []
    for word in words:
        if joined and re.fullmatch('--[a-z-]+', joined[-1]) and re.match(r'-\.?\d', word):
            joined[-1] += '=' + word
        else:
            joined.append(word)
    return joined


def _installation(package: str) -> str:
    """Return the commands that install a package of Python or, by its name, of ROS's messages."""
    if package.endswith(('_msgs', '_srvs')):
        return f'apt install ros-jazzy-{package.replace("_", "-")}, or run scripts/setup'
    pip, apt = _PACKAGES.get(package, (package, package))
    return f'pip install {pip}, or apt install python3-{apt}'


def is_of_ros(error: RuntimeError) -> bool:
    """Return whether an error is rclpy's own, such as for a ROS_DOMAIN_ID that is no number."""
    return type(error).__module__.partition('.')[0] == 'rclpy'


def os_error_text(error: OSError) -> str:
    """Return the system's error message with the file's name, without the error number."""
    if error.strerror is None:
        return str(error)
    return f'{error.filename}: {error.strerror}' if error.filename else error.strerror


def complain(prog: str, message: str) -> int:
    """Print a message as one line on standard error; return 2."""
    print(f'{prog}: ' + ' '.join(message.split()), file=sys.stderr)
    return 2


def warn(prog: str, notice: str | None) -> None:
    """Print a warning, if there is one, as one line on standard error."""
    if notice:
        complain(prog, f'warning: {notice}')


if __name__ == '__main__':
    sys.exit(main())
