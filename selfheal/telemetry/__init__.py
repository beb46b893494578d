"""Faults of a log: a recording and its model in, what no physics can explain out."""

from .check import Telemetry, check_telemetry, examine_telemetry
from .fault import Fault, list_decisive, list_tolerable, refuse_faulty
from .registry import KINDS

__all__ = [
    "KINDS",
    "Fault",
    "Telemetry",
    "check_telemetry",
    "examine_telemetry",
    "list_decisive",
    "list_tolerable",
    "refuse_faulty",
]
