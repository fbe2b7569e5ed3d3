"""Which source a tracker is made of, so that results are reused only while it's the same."""

from __future__ import annotations

import ast
from functools import lru_cache
import hashlib
from importlib.util import resolve_name
from pathlib import Path

_PACKAGE = __name__.partition('.')[0]
_ROOT = Path(__file__).resolve().parents[1]


def source_hash(*modules: str) -> str:
    """
    Return a hash of the source of modules and of all that they import from this package.

    A module's own parent packages don't count, only what's imported by name: a tracker's hash
    doesn't change with another tracker's source.
    """
    digest = hashlib.sha256()
    for name, path in sorted(source_files(*modules).items()):
        digest.update(name.encode() + b'\0' + path.read_bytes() + b'\0')
    return digest.hexdigest()


def source_files(*modules: str) -> dict[str, Path]:
    """Return the files that `source_hash` reads by module; ModuleNotFoundError for no module."""
    found: dict[str, Path] = {}
    waiting = list(modules)
    while waiting:
        name = waiting.pop()
        if name in found:
            continue
        path = _module_file(name)
        if path is None:
            raise ModuleNotFoundError(f'no module named {name!r}', name=name)
        found[name] = path
        package = name if path.name == '__init__.py' else name.rpartition('.')[0]
        waiting.extend(_imports(path.read_bytes(), package))
    return found


@lru_cache(maxsize=1000)
def _imports(source: bytes, package: str) -> tuple[str, ...]:
    names: list[str] = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names.extend(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = resolve_name('.' * node.level + (node.module or ''), package)
            inner = [f'{base}.{alias.name}' for alias in node.names]
            modules = [name for name in inner if _module_file(name)]
            # `from package import module` needs the package only for names that aren't modules.
            names.extend(modules if len(modules) == len(inner) else [*modules, base])
    return tuple(name for name in names if name.partition('.')[0] == _PACKAGE)


def _module_file(name: str) -> Path | None:
    package, *parts = name.split('.')
    place = _ROOT.joinpath(*parts)
    files = (place / '__init__.py', place.with_suffix('.py')) if package == _PACKAGE else ()
    return next((path for path in files if path.is_file()), None)
