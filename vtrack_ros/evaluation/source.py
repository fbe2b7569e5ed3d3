"""Which source a tracker is made of, so that results are reused only while it's the same."""

from __future__ import annotations

import ast
from functools import lru_cache
import hashlib
from pathlib import Path

_PACKAGE = __name__.partition('.')[0]
_ROOT = Path(__file__).resolve().parents[1]


def source_hash(*modules: str) -> str:
    """
    Return a hash of the source of modules and of all that they import from this package.

    A module's own parent packages don't count, only what's imported by name: a tracker's hash
    doesn't change with another tracker's source.

    Parameters
    ----------
    *modules : str
        Full names, such as ``vtrack_ros.trackers.particle``.

    Raises
    ------
    ModuleNotFoundError
        If one doesn't exist.

    """
    digest = hashlib.sha256()
    for name, path in sorted(source_files(*modules).items()):
        digest.update(name.encode() + b'\0' + path.read_bytes() + b'\0')
    return digest.hexdigest()


def source_files(*modules: str) -> dict[str, Path]:
    """Return the files that `source_hash` reads, by module."""
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
            base = node.module or ''
            if node.level:
                parents = package.split('.')[:len(package.split('.')) - node.level + 1]
                base = '.'.join([*parents, *filter(None, [base])])
            submodules = [f'{base}.{alias.name}' for alias in node.names]
            modules = [name for name in submodules if _of_package(name) and _module_file(name)]
            names.extend(modules)
            # `from package import module` needs the package only for names that aren't modules.
            if len(modules) < len(submodules):
                names.append(base)
    return tuple(name for name in names if _of_package(name))


def _of_package(name: str) -> bool:
    return name.partition('.')[0] == _PACKAGE


def _module_file(name: str) -> Path | None:
    place = _ROOT.joinpath(*name.split('.')[1:])
    for path in (place / '__init__.py', place.with_suffix('.py')):
        if path.is_file():
            return path
    return None
