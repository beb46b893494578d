"""Recordings (contract section 1): takes HDF5 files, gives checked arrays, and back."""

from .check import validate
from .data import KINDS, Episode, Recording, Signal
from .model import ModelNames, Target, check_against_model
from .names import load_model, names_of, read_names, read_spec
from .split import short_names, split, whole_of, without_file
from .store import opened, read, write

__all__ = [
    "KINDS",
    "Episode",
    "ModelNames",
    "Recording",
    "Signal",
    "Target",
    "check_against_model",
    "load_model",
    "names_of",
    "opened",
    "read",
    "read_names",
    "read_spec",
    "short_names",
    "split",
    "validate",
    "whole_of",
    "without_file",
    "write",
]
