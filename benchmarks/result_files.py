"""Result files: JSON with one row of figures on a line."""

from __future__ import annotations

from collections.abc import Mapping
import json
import math
from pathlib import Path
from typing import Any

#: Upper bound of a line's length, [characters], without indentation and name.
LONGEST = 500


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Write figures with four digits; a value of at most `LONGEST` characters has one line."""
    path.write_text(_text(_rounded(content), '') + '\n', encoding='utf-8')


def facts_text(facts: Mapping[str, Any]) -> str:
    """Return on one line the `environment` that figures were measured in."""
    return ', '.join(f'{key} {value}' for key, value in facts.items())


def interval_text(values: tuple[float, float, float]) -> str:
    """Return a mean difference with the ends of its interval."""
    mean, low, high = values
    return f'{mean:+.3f} [{low:+.3f}, {high:+.3f}]'


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _rounded(one) for key, one in value.items()}
    if isinstance(value, list):
        return [_rounded(one) for one in value]
    if isinstance(value, float):
        return float(f'{value:.4g}') if math.isfinite(value) else None
    return value


def _text(value: Any, indent: str) -> str:
    text = json.dumps(value, ensure_ascii=False, allow_nan=False)
    if not isinstance(value, (dict, list)) or len(text) <= LONGEST:
        return text
    deeper = indent + ' '
    rows = ([f'{json.dumps(key, ensure_ascii=False)}: {_text(one, deeper)}'
             for key, one in value.items()] if isinstance(value, dict)
            else [_text(one, deeper) for one in value])
    opening, closing = '{}' if isinstance(value, dict) else '[]'
    return opening + ','.join(f'\n{deeper}{row}' for row in rows) + f'\n{indent}{closing}'
