"""What commands print: takes results, writes tables or one JSON object to stdout."""

import json
from collections.abc import Mapping
from typing import Any

import typer


def print_json(result: Mapping[str, Any]) -> None:
    """Print one JSON object, and refuse what JSON has no word for (NaN)."""
    typer.echo(json.dumps(result, allow_nan=False))
