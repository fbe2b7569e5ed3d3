"""Result files: JSON with one row of figures on a line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Write figures in four digits; what holds nothing but figures and names takes one line."""
    path.write_text(_text(_rounded(content), '') + '\n', encoding='utf-8')


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _rounded(one) for key, one in value.items()}
    if isinstance(value, list):
        return [_rounded(one) for one in value]
    return float(f'{value:.4g}') if isinstance(value, float) else value


def _text(value: Any, indent: str) -> str:
    inner = value.values() if isinstance(value, dict) else value
    if not isinstance(value, (dict, list)) or not any(isinstance(one, dict) for one in inner):
        return json.dumps(value, ensure_ascii=False, allow_nan=False)
    deeper = indent + ' '
    rows = ([f'{json.dumps(key, ensure_ascii=False)}: {_text(one, deeper)}'
             for key, one in value.items()] if isinstance(value, dict)
            else [_text(one, deeper) for one in value])
    opening, closing = '{}' if isinstance(value, dict) else '[]'
    return opening + ','.join(f'\n{deeper}{row}' for row in rows) + f'\n{indent}{closing}'
