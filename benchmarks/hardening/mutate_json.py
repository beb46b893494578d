"""Broken JSON: a text and a seed in; a text that says something else out."""

import json
from typing import Any

import numpy as np

_DEEP = "nested deeply"  # stands for lists in lists until the text is written
_ODD: tuple[Any, ...] = (
    None, True, False, 0, -1, 1e307, -1e307, 10**400, 2**63, float("nan"),
    float("inf"), "", "nan", "no such name", "joint:no_such", "../../etc/passwd",
    100_000 * "x", [], {}, [None], {"": None}, [[]], 1000 * [0.5], _DEEP,
)  # fmt: skip


def mutate_json(content: bytes, seed: int) -> bytes:
    """Change a value of a JSON text, or a few; what is no JSON is replaced."""
    rng = np.random.default_rng(seed)
    try:
        document = json.loads(content)
    except ValueError:
        document = None
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        document = _change_value(document, rng)
    text = json.dumps(document)
    return text.replace(f'"{_DEEP}"', 100_000 * "[" + 100_000 * "]").encode()


def _change_value(document: Any, rng: np.random.Generator) -> Any:
    """The document with one of its values changed, at a depth drawn on the way."""
    inner = isinstance(document, dict | list) and len(document) > 0
    if not inner or rng.random() < 0.1:
        return _draw_odd(document, rng)
    document = document.copy()
    keys = list(document) if isinstance(document, dict) else range(len(document))
    key = keys[rng.integers(len(keys))]
    chance = rng.random()
    if chance < 0.6:
        document[key] = _change_value(document[key], rng)
    elif chance < 0.75:
        del document[key]
    elif isinstance(document, dict):
        document[f"{key}2" if chance < 0.9 else ""] = document.pop(key)
    else:
        document.insert(key, document[key] if chance < 0.9 else _draw_odd(None, rng))
    return document


def _draw_odd(value: Any, rng: np.random.Generator) -> Any:
    """Something in the place of a value: another number, or something else."""
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if number and abs(value) < 1e300 and rng.random() < 0.4:
        return value * float(rng.choice([-1, 0.5, 2, 1e3, 1e6, 1e12, 1e-12]))
    return _ODD[rng.integers(len(_ODD))]
