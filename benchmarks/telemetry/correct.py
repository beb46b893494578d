"""Corrections done by a script: a set-up and its faults in, corrected files out.

A set-up goes the way of a user: a table and a map, from which a recording is imported.
"""

import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco

from benchmarks.telemetry.setups import Setup
from selfheal.export.export import export_recording
from selfheal.logs.convert import import_logs
from selfheal.logs.log_map import COMMAND, ColumnRule, EpisodeRule, LogMap, TimeBase
from selfheal.logs.open_log import open_log
from selfheal.preparation.drives import Gains
from selfheal.preparation.prepare import prepare_model, write_model
from selfheal.recording import KINDS, Recording, load_model, read
from selfheal.telemetry import Fault
from selfheal.telemetry.fault import Correction, ModelCorrection
from selfheal.telemetry.map_corrections import correct_rules

_LEFT_OUT = re.compile(r"leave episode (.+?) out")


@dataclass
class Files:
    """A log as a table, a map and a model in a folder.

    Attributes:
        gains: of the drives, as the robot's maker states them.
    """

    folder: Path
    recording: Recording
    log_map: LogMap
    gains: Mapping[str, tuple[float, float]]

    @property
    def model(self) -> Path:
        """File of the model."""
        return self.folder / "model.xml"

    def import_recording(self) -> tuple[Recording, mujoco.MjModel]:
        """The recording by the map, and the compiled model."""
        table, out = self.folder / "log.csv", self.folder / "recording.h5"
        export_recording(self.recording, table, to="csv")
        model = load_model(self.model)
        import_logs([open_log(table)], self.log_map, model, out)
        return read(out), model


def write_setup(
    setup: Setup, folder: Path, gains: Mapping[str, tuple[float, float]]
) -> Files:
    """The files of a set-up."""
    first = next(iter(setup.recording.episodes.values()))
    rules = []
    for kind in KINDS:
        chosen = {n: s for n, s in first.signals.items() if s.kind == kind}
        columns = [
            f"signals/{n}[{k}] [{s.unit}]"
            if s.values.ndim > 1
            else f"signals/{n} [{s.unit}]"
            for n, s in chosen.items()
            for k in range(s.values.shape[1] if s.values.ndim > 1 else 1)
        ]
        if chosen:
            targets = [s.target for s in chosen.values()]
            rules.append(ColumnRule(kind, columns, targets))
    log_map = LogMap(rules, TimeBase("time [s]"), EpisodeRule("episode"))
    files = Files(folder, setup.recording, log_map, gains)
    files.model.write_text(setup.xml)
    _map_commands(files)
    return files


def _map_commands(files: Files) -> None:
    """Commands go to the model's actuators, in the order of the joints."""
    model = load_model(files.model)
    first = next(iter(files.recording.episodes.values()))
    signals = [r for r in files.log_map.signals if r.kind != COMMAND]
    if model.nu:
        columns = [f"ctrl/{n}" for n in first.ctrl_names]
        targets = [model.actuator(a).name for a in range(model.nu)]
        signals.insert(0, ColumnRule(COMMAND, columns, targets))
    files.log_map = replace(files.log_map, signals=signals)


def correct(files: Files, faults: list[Fault], recording: Recording) -> None:
    """Do what all faults say.

    Args:
        files: of the set-up; they are changed.
    """
    changed = correct_rules(files.log_map, faults, recording)
    rules = [
        new
        for number, rule in enumerate(files.log_map.signals)
        for new in changed.get(number, [rule])
    ]
    files.log_map = replace(files.log_map, signals=rules)
    for fault in faults:
        # words beside an element say how else it could be written
        elements = [c for c in fault.corrections if isinstance(c, ModelCorrection)]
        for one in elements or fault.corrections:
            _follow(files, one)


def _follow(files: Files, one: Correction) -> None:
    """Do what one correction says of the model or of an episode."""
    if isinstance(one, ModelCorrection):
        _edit_model(files, ET.fromstring(one.xml))
    elif isinstance(one, str) and "selfheal model prepare" in one:
        kp, kv = ({j: g[k] for j, g in files.gains.items()} for k in (0, 1))
        drives = Gains(kp, kv, (), not kp) if "--kp" in one else Gains({}, {})
        weld = "--weld-base" in one
        made = prepare_model(
            files.model, files.folder, drives, weld_base=weld, without_contacts=False
        )
        write_model(made, files.model)
        _map_commands(files)
    elif isinstance(one, str) and (found := _LEFT_OUT.search(one)):
        left_out = [name.strip("' ") for name in found[1].split(",")]
        rest = files.recording.episodes.items()
        episodes = {k: e for k, e in rest if k not in left_out}
        files.recording = replace(files.recording, episodes=episodes)


def _edit_model(files: Files, new: ET.Element) -> None:
    """Put an element into the model, or its attributes where it is by name."""
    root = ET.parse(files.model).getroot()
    name = new.get("name")
    if name is None:
        contact = root.find("contact")
        contact = ET.SubElement(root, "contact") if contact is None else contact
        contact.append(new)
    elif (found := root.find(f".//{new.tag}[@name='{name}']")) is not None:
        found.attrib |= new.attrib
    else:  # an actuator of another kind
        found = root.find(f"actuator/*[@name='{name}']")
        assert found is not None
        kp, kv = files.gains[new.attrib["joint"]]
        found.tag = new.tag
        found.attrib = new.attrib | {"kp": f"{kp:.6g}", "kv": f"{kv:.6g}"}
    ET.ElementTree(root).write(files.model)
