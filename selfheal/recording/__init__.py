"""Recordings (contract section 1): takes HDF5 files, gives checked arrays, and back."""

from .check import validate
from .controls import (
    find_controls,
    find_joint,
    find_output,
    find_single_columns,
    list_controls,
    reorder_commands,
)
from .data import KINDS, Episode, Signal
from .model import NO_ACTUATORS, ModelNames, Target, check_against_model
from .names import list_model_names, load_model, read_names, read_spec
from .recording import Recording
from .split import shorten_names, split, strip_file, strip_window
from .store import open_recording, read
from .writing import open_writer, write

__all__ = [
    "KINDS",
    "NO_ACTUATORS",
    "Episode",
    "ModelNames",
    "Recording",
    "Signal",
    "Target",
    "check_against_model",
    "find_controls",
    "find_joint",
    "find_output",
    "find_single_columns",
    "list_controls",
    "list_model_names",
    "load_model",
    "open_recording",
    "open_writer",
    "read",
    "read_names",
    "read_spec",
    "reorder_commands",
    "shorten_names",
    "split",
    "strip_file",
    "strip_window",
    "validate",
    "write",
]
