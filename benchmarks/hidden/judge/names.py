"""Names judged: takes findings, truths and the model, gives what was right."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import mujoco
import numpy as np
from scipy.optimize import linear_sum_assignment

from benchmarks.hidden.effects.unlisted import RELATED

# effects.md section 1: pairs that motion alone does not separate
CLASSES = (
    {"viscous_friction", "servo_gain"},
    {"command_delay", "sensor_delay"},
    {"joint_spring", "sensor_gain"},
    {"slope", "wind"},
    {"coulomb_friction", "stribeck_friction"},
    {"payload", "com_shift"},
)
# what a diagnosis may call an effect of drives, besides its name
ALSO = {
    "coulomb_friction": ("stribeck_friction", "asymmetric_friction"),
    "clock_shift": ("command_delay", "sensor_delay"),
    "torque_constant": ("servo_gain",),
    "base_compliance": ("compliance",),
}
EVERYWHERE = ("clock_shift", "gravity_compensation", "base_compliance")
WORLDLY = {"ground_friction", "ground_compliance", "fluid_drag", "wind", "slope"}
TURNS = {"phase", "azimuth"}  # angles that are the same after a whole turn

Finding = Mapping[str, Any]  # of diagnosis.json, or a truth of the key
Judged = dict[str, Any]


@dataclass(frozen=True)
class Places:
    """What of a model is the same place: joint, its actuators, signals and body.

    Attributes:
        same: by target: every name of the place.
    """

    same: Mapping[str, frozenset[str]]

    def find_place(self, finding: Finding) -> frozenset[str]:
        """The place of a finding or of a truth."""
        target = str(finding.get("target", ""))
        world = {"world"} if finding.get("effect") in WORLDLY else set()
        return self.same.get(target, frozenset({target})) | world

    def are_same(self, one: Finding, other: Finding) -> bool:
        """Whether two findings or truths are at one place."""
        return bool(self.find_place(one) & self.find_place(other))


def read_places(case: Path) -> Places:
    """What is the same place in a case's model and recording."""
    model = mujoco.MjModel.from_xml_path(str(case / "model.xml"))
    same: dict[str, frozenset[str]] = {"world": frozenset({"world"})}
    for b in range(1, model.nbody):
        name = f"body:{model.body(b).name}"
        first, count = model.body_jntadr[b], model.body_jntnum[b]
        joints = [f"joint:{model.joint(first + j).name}" for j in range(count)]
        same[name] = frozenset({name, *joints})
        same |= {joint: frozenset({joint, name}) for joint in joints}
    for a in range(model.nactuator):
        name, at = f"actuator:{model.actuator(a).name}", model.actuator_trnid[a, 0]
        if model.actuator_trntype[a] == mujoco.mjtTrn.mjTRN_SITE:
            same[name] = frozenset({name})  # one body may have several
        else:
            same[name] = same[f"joint:{model.joint(at).name}"]
    for g in range(model.ngeom):
        body = model.geom_bodyid[g]
        name = f"body:{model.body(body).name}"
        same[f"geom:{model.geom(g).name}"] = same[name] if body else same["world"]
    return Places(same | _place_signals(case, same))


def _place_signals(case: Path, same: Mapping[str, frozenset[str]]):
    """The place of every signal."""
    found = {}
    with h5py.File(case / "recording.h5") as file:
        episode = next(iter(file["episodes"].values()))
        for name, signal in episode["signals"].items():
            kind = signal.attrs["kind"].partition("_")[0]
            kind = "actuator" if signal.attrs["kind"] == "joint_torque" else kind
            target = f"{kind}:{signal.attrs['target']}"
            found[f"sensor:{name}"] = same.get(target, frozenset({target}))
    return found


def are_alike(one: str, other: str) -> bool:
    """Whether two effects are the same, or of one class."""
    return one == other or any({one, other} <= c for c in CLASSES)


def names_truth(finding: Finding, truth: Finding) -> bool:
    """Whether a finding is the truth, of its class, or says that it may be it."""
    name = truth["effect"]
    return are_alike(finding["effect"], name) or name in finding.get("equivalent", ())


def select_real_findings(diagnosis: Finding, key: Finding) -> list[Finding]:
    """Findings without the encoder steps that the noise itself made true."""
    steps = {("quantization", sensor) for sensor in key.get("quantized_noise", ())}
    findings = diagnosis.get("findings") or []
    return [f for f in findings if (f["effect"], f["target"]) not in steps]


def describe(findings: Sequence[Finding]) -> list[str]:
    """Effects and targets of findings or truths."""
    return [f"{f['effect']} {f['target']}" for f in findings]


def judge_case(key: Finding, diagnosis: Finding, places: Places) -> Judged:
    """What was right in one case, by its key and diagnosis.json; {} if it has none."""
    findings = select_real_findings(diagnosis, key)
    judged = {
        "seed": key["seed"],
        "kind": key["kind"],
        "robot": key["robot"],
        "truth": describe(key["effects"]),
        "verdict": diagnosis.get("verdict", "failed"),
        "found": describe(findings),
        "removed": (diagnosis.get("fit") or {}).get("explainable_removed"),
    }
    found = Found(key["effects"], findings, places, judged["verdict"])
    return judged | _JUDGES[key["kind"]](found)


@dataclass(frozen=True)
class Found:
    """What was found in a case, beside its truths."""

    truths: Sequence[Finding]
    findings: Sequence[Finding]
    places: Places
    verdict: str


def _judge_null(case: Found) -> Judged:
    return {"false_name": bool(case.findings), "quiet": case.verdict == "nothing"}


def _judge_unlisted(case: Found) -> Judged:
    related = RELATED.get(case.truths[0]["effect"], ())
    described = all(f["effect"] in related for f in case.findings)
    return {
        "no_wrong_name": not case.findings and case.verdict != "failed",
        "related_only": described and case.verdict not in ("explained", "failed"),
        "noticed": case.verdict in ("unlisted", "partly", "explained"),
    }


def _judge_single(case: Found) -> Judged:
    (truth,), findings = case.truths, case.findings
    named = [names_truth(f, truth) for f in findings]
    first = findings[0] if findings else {"effect": case.verdict}
    return {
        "first": first["effect"],
        "exact": bool(findings) and first["effect"] == truth["effect"],
        "class": any(named[:1]),
        "place": bool(findings) and case.places.are_same(first, truth),
        "listed": any(named),
        "extra": named.count(False),
        "covered": check_intervals(case),
    }


def _judge_double(case: Found) -> Judged:
    def is_exact(finding: Finding, truth: Finding) -> bool:
        return bool(finding["effect"] == truth["effect"])

    def is_placed(finding: Finding, truth: Finding) -> bool:
        return names_truth(finding, truth) and case.places.are_same(finding, truth)

    fits = {"exact": is_exact, "class": names_truth, "class and place": is_placed}
    return {
        "hits": {how: _count_matches(case, fit) for how, fit in fits.items()},
        "truths": len(case.truths),
        "findings": len(case.findings),
        "covered": check_intervals(case),
    }


_JUDGES = {
    "null": _judge_null,
    "unlisted": _judge_unlisted,
    "single": _judge_single,
    "double": _judge_double,
}


def _count_matches(case: Found, fits: Callable[[Finding, Finding], bool]) -> int:
    """The most pairs of a truth and a finding that fit, each used once."""
    pairs = np.array([[fits(f, t) for f in case.findings] for t in case.truths], int)
    pairs = pairs.reshape(len(case.truths), len(case.findings))
    return int(pairs[linear_sum_assignment(pairs, maximize=True)].sum())


def check_intervals(case: Found) -> list[Judged]:
    """Whether the interval of each parameter of a right effect holds the truth."""
    found = []
    for truth in case.truths:
        right = (f for f in case.findings if f["effect"] == truth["effect"])
        placed = (f for f in right if case.places.are_same(f, truth))
        if finding := next(placed, None):
            found += _check_parameters(truth, finding)
    return found


def _check_parameters(truth: Finding, finding: Finding) -> list[Judged]:
    stated = dict(_flatten_parameters(finding.get("parameters", ())))
    found = []
    for parameter in truth["parameters"]:
        name, value = parameter["name"], parameter["value"]
        if name not in stated or None in stated[name]:
            continue
        middle, low, high = stated[name]
        if name in TURNS:
            value += 2 * math.pi * round((middle - value) / (2 * math.pi))
        error = abs(middle - value) / abs(value) if value else None
        label = f"{truth['effect']} {name}"
        inside = bool(low <= value <= high)
        found.append({"parameter": label, "inside": inside, "error": error})
    return found


def _flatten_parameters(
    parameters: Sequence[Finding],
) -> Iterator[tuple[str, Sequence[float | None]]]:
    """Name and (value, low, high), a vector as its columns x, y, z."""
    for p in parameters:
        numbers: list[Any] = [p.get(key) for key in ("value", "low", "high")]
        if not isinstance(p.get("value"), (list, tuple)):
            yield p["name"], numbers
            continue
        for axis, triple in zip("xyz", zip(*numbers, strict=True), strict=True):
            yield f"{p['name']}_{axis}", triple


# ---------------------------------------------------------------- several at once


def _is_named(finding: Finding, effect: Finding, places: Places) -> bool:
    """Whether a finding's name, or one that it says may be it, is an effect's."""
    names, good = {finding["effect"], *finding.get("equivalent", ())}, effect["names"]
    if not (names & set(good) or are_alike(finding["effect"], good[0])):
        return False
    if good[0] in EVERYWHERE:
        return True
    return places.are_same(finding, effect)


def judge_names(
    findings: Sequence[Finding], effects: Sequence[Finding], places: Places
) -> Judged:
    """Which needed effects were named at their place, and which names are false."""
    missed = [
        f"{e['names'][0]} {e['target']}"
        for e in effects
        if e["needed"] and not any(_is_named(f, e, places) for f in findings)
    ]
    false = [f for f in findings if not any(_is_named(f, e, places) for e in effects)]
    needed = sum(e["needed"] for e in effects)
    return {
        "needed": needed,
        "named": needed - len(missed),
        "missed": missed,
        "names": len(findings),
        "false": describe(false),
    }
