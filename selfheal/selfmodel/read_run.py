"""Runs read back: a file in, the run that it holds out, every member checked."""

import json
import os
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from ..body.body import Anatomy, Bodies, Ints
from ..body.genome import HINGE_NAMES, Genomes
from ..engine.channels import list_channels
from ..errors import InputError
from ..schema import (
    ROUNDING,
    ArraySchema,
    Count,
    Members,
    Number,
    PositiveCount,
    open_members,
)
from .run import FORMAT, VERSION, Cycle, Run, Settings, uses_second_engine

HingeKind = Annotated[int, Field(ge=0, lt=len(HINGE_NAMES))]
# [m], [kg] or [rad]: what is beyond is damage; chosen
_SMALLEST, _LARGEST = 1e-9, 1e6


def _make_size(*shape: int | str, least: float = _SMALLEST) -> ArraySchema:
    """Lengths or masses [m or kg]."""
    return ArraySchema(shape, low=least, high=_LARGEST)


def _make_place(*shape: int | str) -> ArraySchema:
    """Positions or angles [m or rad]."""
    return ArraySchema(shape, low=-_LARGEST, high=_LARGEST)


# What a file holds, by name. P parts, A actions, N bodies, K rivals; see the classes.
_ANATOMY = {
    "name": str,
    "parts": tuple[str, ...],
    "joints": tuple[str, ...],
    "torso_half": _make_size(3),
    "torso_mass": _make_size(),
    "rim": _make_place(3),
    "length": _make_size("P"),
    "radius": _make_size("P"),
    "mass": _make_size("P"),
    "block_half": _make_size("P", 3, least=0.0),
    "block_center": _make_place("P"),
    "block_mass": _make_size("P", least=0.0),
    "feet": tuple[PositiveCount, ...],
    "hinges": tuple[HingeKind, ...],
    "bends": tuple[Number, ...],
    "fixed": bool,
    "ordered": bool,
    "sensors": tuple[str, ...],
}
_BODY = {
    "parent": ArraySchema((1, "P"), "int", is_tree=True),
    "anchor": _make_place(1, "P", 3),
    "heading": _make_place(1, "P"),
    "axis": _make_place(1, "P", 3),
    "length": _make_size(1, "P"),
    "thickness": _make_size(1, "P"),
    "mass": _make_size(1, "P"),
}
_GENOMES = {
    "parent": ArraySchema(("K", "P"), "int", is_tree=True),
    "placement": ArraySchema(("K", "P"), low=0.0, high=1.0),
    "hinge": ArraySchema(("K", "P"), "int", 0, len(HINGE_NAMES) - 1),
    "length": _make_size("K", "P"),
}
_RIVALS = {
    "tables": ArraySchema(("K", "A", "C"), has_gaps=True),
    "losses": ArraySchema(("K",), has_gaps=True),
}
_SURENESS = ArraySchema(("P",), low=0.0, high=1.0 + ROUNDING, has_gaps=True)
_CYCLE = {
    "action": ArraySchema((), "int", 0),
    "why": str,
    "felt": ArraySchema(("C",), has_gaps=True),
    **_RIVALS,
    "sureness": _SURENESS,
    "tilt_error": ArraySchema(has_gaps=True),
    "disagreement": ArraySchema(has_gaps=True),
    "spent": ArraySchema((), "int", 0),
    "seconds": ArraySchema(low=0.0),
}
# what the search goes on from, as the strategies capture it
_CROWD = {**_GENOMES, **_RIVALS}
_CLIMBERS = {
    "strategy_genes": ArraySchema(("K", "P"), low=0.0, high=1.0),
    "strategy_losses": ArraySchema(("K",), has_gaps=True),
    "strategy_weight": ArraySchema(low=0.0, high=1.0),
}
_ANY_METHOD = {"hardness": ArraySchema(("A",), has_gaps=True), "random": str}
_SECOND_ENGINE = {
    "judge_keys": ArraySchema(("J", None), "byte"),
    "judge_values": ArraySchema(("J", "C"), has_gaps=True),
}


@dataclass(frozen=True)
class DynamicsResult:
    """What a run says of moves over time; errors are as in diagnosis.json.

    Attributes:
        held: whether the torso lay still in all moves, and counts as bolted down.
        given: error of the best body on a held-out move [1].
        patched: the same with what was found [1].
        floor: what noise alone leaves [1].
    """

    moves: str
    diagnosis: str
    model: str
    held: bool
    verdict: str
    given: Number
    patched: Number
    floor: Number


@dataclass(frozen=True)
class IdentifyResult:
    """What `identify --json` prints, as the schema of a run's result.

    Attributes:
        parent: (P) what each part hangs on; 0 is the torso.
        sureness: (P) stated probability that each attachment is right.
        length: (P) of the parts [m].
        tilt_error: of the best body on the reference engine [deg].
        actions: tried, each as the joints that go down or as joint targets [rad].
        seconds: that it took [s].
        dynamics: of its joints; None where no moves were asked for.
    """

    format: str
    version: int
    robot: str
    method: str
    seed: int
    parent: list[int]
    sureness: list[Number]
    length: list[Number]
    tilt_error: Number
    actions: list[list[Number]]
    simulations: dict[str, Count]
    seconds: Number = 0.0
    run: str = ""
    model: str = ""
    dynamics: DynamicsResult | None = None


def load_run(path: str | os.PathLike[str]) -> Run:
    """Read a run.

    Raises:
        RunFileError: missing, held by another process, truncated, no run file, or of
            another version.
    """
    with open_members(path, "run file", form=FORMAT, version=VERSION) as file:
        return _read_run(file)


def _read_run(file: Members) -> Run:
    """The run in an open file."""
    settings = file.read_json("settings", Settings)
    anatomy = _read_anatomy(file)
    actions = file.read("actions", _make_place("A", "P"))
    cycles = _read_cycles(file)
    counts = file.read_json("counts", dict[str, Count])
    truth = None
    if "truth" in file.list_names():
        truth = Bodies(anatomy, **file.open_group("truth").read_table(_BODY))
    run = Run(
        settings=settings,
        anatomy=anatomy,
        actions=actions,
        cycles=cycles,
        truth=truth,
        counts=counts,
        result=_read_result(file, cycles),
        indistinguishable=_read_indistinguishable(file),
    )
    return replace(run, state=_read_state(file, run))


def _read_anatomy(file: Members) -> Anatomy:
    """The robot's parts; their number is P from here on."""
    group = file.open_group("anatomy")
    count = len(group.read("parts", tuple[str, ...]))
    group.sizes["P"] = file.sizes["P"] = count
    anatomy = Anatomy(**group.read_table(_ANATOMY))
    if not count:
        raise group.make_error("parts", "empty", "a name each")
    if len(anatomy.joints) != count:
        found = f"of {len(anatomy.joints)} names"
        raise group.make_error("joints", found, f"{count}, one each part")
    if not all(foot <= count for foot in anatomy.feet):
        raise group.make_error("feet", f"{anatomy.feet}", f"parts from 1 to {count}")
    for name in ("hinges", "bends"):
        if len(getattr(anatomy, name)) not in (0, count):
            raise group.make_error(name, "of another length", f"none or {count}")
    try:
        group.sizes["C"] = file.sizes["C"] = len(list_channels(anatomy))
    except InputError as error:
        raise group.make_error("sensors", str(error), "those of its parts") from error
    return anatomy


def _read_cycles(file: Members) -> tuple[Cycle, ...]:
    """The cycles in order; none where there is no group of them."""
    if "cycles" not in file.list_names():
        return ()
    group, cycles = file.open_group("cycles"), []
    for k in range(len(group.list_names())):
        members = group.open_group(f"{k:03d}")
        values = members.read_table(_CYCLE)
        if values["action"] >= members.sizes["A"]:
            fits = f"0 to {members.sizes['A'] - 1}"
            raise members.make_error("action", str(values["action"]), fits)
        genomes = Genomes(**members.open_group("genomes").read_table(_GENOMES))
        cycles.append(Cycle(**values, genomes=genomes))
    return tuple(cycles)


def _read_result(file: Members, cycles: tuple[Cycle, ...]) -> dict[str, Any]:
    """What `identify` said in the end; empty until then."""
    result = file.read_document("result", IdentifyResult)
    if result and not cycles:
        raise file.make_error("cycles", "missing", "what the result comes from")
    if result:
        file.check_list("result.sureness", result["sureness"], _SURENESS)
    return result


def _read_indistinguishable(file: Members) -> Ints:
    """(M, P) parents; (0, 0) where there are none."""
    found = file.read("alike", ArraySchema((None, None), "int"))
    kind = ArraySchema((None, "P"), "int", is_tree=True)
    return file.read("alike", kind) if len(found) else found


def _read_state(file: Members, run: Run) -> dict[str, np.ndarray | str]:
    """What the search goes on from; none before it, and none is needed after it."""
    group, settings = file.open_group("state"), run.settings
    if not group.list_names() and (run.result or not run.cycles):
        return {}
    state, engines = group.read_table(_ANY_METHOD), {settings.engine}
    if settings.method == "default":
        for start in ("strategy_", "strategy_kin_"):
            table = {f"{start}{name}": kind for name, kind in _CROWD.items()}
            state |= replace(group, sizes=dict(group.sizes)).read_table(table)
        state |= group.read_table({"strategy_vain": ArraySchema((), "int", 0)})
    else:
        state |= group.read_table(_CLIMBERS)
    if settings.engine == "auto":
        engines = {"statics"}
        if uses_second_engine(settings, run.anatomy):
            state |= group.read_table(_SECOND_ENGINE)
            engines |= {"mjx"}
    if lacking := {*engines, "choice", "failed"} - {*run.counts}:
        said = f"without {', '.join(sorted(lacking))}"
        raise file.make_error("attribute counts", said, "a number for each engine")
    try:
        known = json.loads(state["random"])
        np.random.default_rng().bit_generator.state = known
    except (ValueError, TypeError, KeyError, OverflowError) as error:
        said = "no state of a random generator"
        raise group.make_error("random", said) from error
    return state
