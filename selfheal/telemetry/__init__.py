"""Faults of a log: a recording and its model in, what no physics can explain out."""

from .check import Telemetry, check_telemetry, examine_telemetry
from .fault import Fault, refuse_faulty
from .registry import KINDS

__all__ = [
    "KINDS",
    "Fault",
    "Telemetry",
    "check_telemetry",
    "examine_telemetry",
    "refuse_faulty",
]
