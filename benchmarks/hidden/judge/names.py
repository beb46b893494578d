"""Names judged: takes findings, truths and the model, gives what was right."""

import math
from collections.abc import Mapping, Sequence
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

Finding = Mapping[str, Any]


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


def select_real_findings(diagnosis: Mapping[str, Any] | None, key: Mapping[str, Any]):
    """Findings without the encoder steps that the noise itself made true."""
    steps = set(key.get("quantized_noise", ()))
    findings = (diagnosis or {}).get("findings") or []
    return [
        f
        for f in findings
        if not (f["effect"] == "quantization" and f["target"] in steps)
    ]


def judge_case(
    key: Mapping[str, Any],
    diagnosis: Mapping[str, Any] | None,
    run: Mapping[str, Any] | None,
    places: Places,
) -> dict[str, Any]:
    """What was right in one case.

    Args:
        diagnosis: diagnosis.json, or None where there is none.
    """
    findings = select_real_findings(diagnosis, key)
    fit = (diagnosis or {}).get("fit") or {}
    judged: dict[str, Any] = {
        "seed": key["seed"],
        "kind": key["kind"],
        "robot": key["robot"],
        "truth": [f"{e['effect']} {e['target']}" for e in key["effects"]],
        "verdict": (diagnosis or {}).get("verdict", "failed"),
        "found": [f"{f['effect']} {f['target']}" for f in findings],
        "removed": fit.get("explainable_removed"),
        "run": {k: v for k, v in (run or {}).items() if k != "stderr"},
    }
    return judged | _JUDGES[key["kind"]](key["effects"], findings, places, judged)


def _judge_null(truths, findings, places: Places, judged) -> dict[str, Any]:
    return {"false_name": bool(findings), "quiet": judged["verdict"] == "nothing"}


def _judge_unlisted(truths, findings, places: Places, judged) -> dict[str, Any]:
    related = RELATED.get(truths[0]["effect"], ())
    described = all(f["effect"] in related for f in findings)
    return {
        "no_wrong_name": not findings and judged["verdict"] not in ("failed",),
        "related_only": described and judged["verdict"] not in ("explained", "failed"),
        "noticed": judged["verdict"] in ("unlisted", "partly", "explained"),
    }


def _judge_single(truths, findings, places: Places, judged) -> dict[str, Any]:
    truth = truths[0]
    first = findings[0] if findings else None
    right = first is not None and names_truth(first, truth)
    return {
        "first": first["effect"] if first else judged["verdict"],
        "exact": first is not None and first["effect"] == truth["effect"],
        "class": right,
        "place": first is not None
        and bool(places.find_place(first) & places.find_place(truth)),
        "listed": any(names_truth(f, truth) for f in findings),
        "extra": sum(not names_truth(f, truth) for f in findings),
        "covered": check_intervals(truths, findings, places),
    }


def _judge_double(truths, findings, places: Places, judged) -> dict[str, Any]:
    def exact(finding, truth):
        return finding["effect"] == truth["effect"]

    def placed(finding, truth):
        same = places.find_place(finding) & places.find_place(truth)
        return names_truth(finding, truth) and bool(same)

    return {
        "hits": {
            "exact": _count_matches(truths, findings, exact),
            "class": _count_matches(truths, findings, names_truth),
            "class and place": _count_matches(truths, findings, placed),
        },
        "truths": len(truths),
        "findings": len(findings),
        "covered": check_intervals(truths, findings, places),
    }


_JUDGES = {
    "null": _judge_null,
    "unlisted": _judge_unlisted,
    "single": _judge_single,
    "double": _judge_double,
}


def _count_matches(truths: Sequence, findings: Sequence, fits) -> int:
    """The most pairs of a truth and a finding that fit, each used once."""
    pairs = np.array([[fits(f, t) for f in findings] for t in truths], int)
    pairs = pairs.reshape(len(truths), len(findings))
    return int(pairs[linear_sum_assignment(pairs, maximize=True)].sum())


def check_intervals(truths, findings, places: Places) -> list[dict[str, Any]]:
    """Whether the interval of each parameter of a right effect holds the truth."""
    found = []
    for truth in truths:
        for finding in findings:
            same = finding["effect"] == truth["effect"]
            if same and places.find_place(finding) & places.find_place(truth):
                found += _check_parameters(truth, finding)
                break
    return found


def _check_parameters(truth: Finding, finding: Finding) -> list[dict[str, Any]]:
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


def _flatten_parameters(parameters):
    """Name and (value, low, high), a vector as its columns x, y, z."""
    for p in parameters:
        value, low, high = p.get("value"), p.get("low"), p.get("high")
        if not isinstance(value, (list, tuple)):
            yield p["name"], (value, low, high)
            continue
        for axis, triple in zip("xyz", zip(value, low, high, strict=True), strict=True):
            yield f"{p['name']}_{axis}", triple


# ---------------------------------------------------------------- several at once


def _is_named(finding: Finding, effect: Mapping[str, Any], places: Places) -> bool:
    """Whether a finding's name, or one that it says may be it, is an effect's."""
    names, good = {finding["effect"], *finding.get("equivalent", ())}, effect["names"]
    if not (names & set(good) or are_alike(finding["effect"], good[0])):
        return False
    if good[0] in EVERYWHERE:
        return True
    return bool(places.find_place(finding) & places.find_place(effect))


def judge_names(
    findings: Sequence[Finding],
    effects: Sequence[Mapping[str, Any]],
    places: Places,
) -> dict[str, Any]:
    """Which needed effects were named at their place, and which names are false."""
    missed = [
        f"{e['names'][0]} {e['target']}"
        for e in effects
        if e["needed"] and not any(_is_named(f, e, places) for f in findings)
    ]
    false = [
        f"{f['effect']} {f['target']}"
        for f in findings
        if not any(_is_named(f, e, places) for e in effects)
    ]
    needed = sum(e["needed"] for e in effects)
    return {
        "needed": needed,
        "named": needed - len(missed),
        "missed": missed,
        "names": len(findings),
        "false": false,
    }
