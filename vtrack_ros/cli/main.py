"""
The command line `vtrack`.

A subcommand is a module with `add_arguments(parser)`, `run(arguments) -> int` and, if it likes,
`EXAMPLES`; a line in `_COMMANDS` makes it known. It's imported only when it's called.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from importlib import import_module
import os
import sys
from typing import NoReturn

#: What `run` may raise about wrong arguments or input: one line for the user.
_USER_ERRORS = (TypeError, ValueError)
_INTERRUPTED = 130
_PIPE_CLOSED = 141


@dataclass(frozen=True)
class Command:
    """A subcommand: the module that runs it, and a line about it."""

    module: str
    summary: str


_COMMANDS = {
    'synth': Command('vtrack_ros.cli.synth', 'render a scene with exact truth into a bag'),
    'import': Command('vtrack_ros.cli.importing', 'make a bag of images or of a video'),
    'play': Command('vtrack_ros.cli.play', 'publish a bag, as ros2 bag play would'),
    'replay': Command('vtrack_ros.cli.replay', 'run a tracker over a bag, without a node'),
    'evaluate': Command('vtrack_ros.cli.evaluate',
                        'compare trackers on bags and image folders with truth'),
}


class Parser(argparse.ArgumentParser):
    """A parser that says what's wrong in one line."""

    def error(self, message: str) -> NoReturn:
        """Print the message and exit with 2."""
        _complain(self.prog, message)
        sys.exit(2)


def main(argv: Sequence[str] | None = None) -> int:
    """
    Run a command line.

    Returns
    -------
    code : int
        0, or 1 where something failed, 2 where the arguments or the input are wrong, 130 after
        Ctrl-C.

    """
    words = list(sys.argv[1:] if argv is None else argv)
    try:
        code = _run(words)
        sys.stdout.flush()
        return code
    except SystemExit as stop:
        return int(stop.code or 0)
    except KeyboardInterrupt:
        return _INTERRUPTED
    except BrokenPipeError:
        # What's still in the buffer has nowhere to go, and must not be tried again at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return _PIPE_CLOSED


def _run(words: list[str]) -> int:
    if words and words[0] in ('-h', '--help', 'help') and len(words) == 1:
        print(_overview())
        return 0
    if words == ['--version']:
        from vtrack_ros import __version__
        print('vtrack', __version__)
        return 0
    if not words:
        return _complain('vtrack', 'no command given; valid are ' + ', '.join(_COMMANDS))
    name = words[0]
    if name not in _COMMANDS:
        near = get_close_matches(name, _COMMANDS, 1)
        hint = f'did you mean {near[0]}?' if near else 'valid are ' + ', '.join(_COMMANDS)
        return _complain('vtrack', f'unknown command {name!r}; {hint}')
    command, prog = _COMMANDS[name], f'vtrack {name}'
    try:
        from vtrack_ros.cli.arguments import negative_values
        module = import_module(command.module)
        parser = Parser(prog, description=_sentence(command.summary),
                        epilog=getattr(module, 'EXAMPLES', None),
                        formatter_class=argparse.RawDescriptionHelpFormatter)
        module.add_arguments(parser)
        return int(module.run(parser.parse_args(negative_values(words[1:]))))
    except ModuleNotFoundError as error:
        if (error.name or '').partition('.')[0] == 'vtrack_ros':
            raise
        _complain(prog, str(error))
        return 1
    except _USER_ERRORS as error:
        return _complain(prog, str(error))
    except BrokenPipeError:
        raise
    except OSError as error:
        _complain(prog, in_words(error))
        return 1


def in_words(error: OSError) -> str:
    """Return what the system found wrong, and where, without its number."""
    known = error.filename is not None and error.strerror is not None
    return f'{error.filename}: {error.strerror}' if known else str(error)


def _overview() -> str:
    lines = ['usage: vtrack COMMAND ...', '',
             'Bags of images, and trackers that follow a target in them.', '', 'commands:']
    lines += [f'  {name:<10}{command.summary}' for name, command in _COMMANDS.items()]
    lines += ['', 'vtrack COMMAND --help tells more, with examples.']
    return '\n'.join(lines)


def _sentence(text: str) -> str:
    return text[0].upper() + text[1:] + '.'


def _complain(prog: str, message: str) -> int:
    text = ' '.join(message.split())
    print(f'{prog}: {text}', file=sys.stderr)
    return 2


if __name__ == '__main__':
    sys.exit(main())
