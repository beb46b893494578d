"""Real devices: each diagnosed from its training file and scored on its test.

    python -m benchmarks.devices --recordings RECORDINGS --out DIR [NAME ...]

Each set is diagnosed in DIR/NAME by a process of its own; what is there already is not
done again. `test.h5`, its samples taken out, is replayed and scored as the contract
says (section 2); makes docs/results/diagnose.md of all that DIR holds.
"""

import json
import shutil
import sys
import tomllib
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco

from benchmarks.diagnosis_runs import (
    DOCUMENT,
    ProcessLimits,
    diagnose_cases,
    score_replay,
)
from benchmarks.recordings import edit_episodes, select_signals
from benchmarks.suites import Record
from benchmarks.writer import make_parser, publish_page
from selfheal.recording import Recording, read, write
from selfheal.study.diagnose import FOUND

HIPS_UP = 0.015  # [m] by which the hips of the raised starfish are too high


@dataclass(frozen=True)
class Device:
    """A set of recordings of one device, as devices.toml says."""

    model: str
    train: str
    test: str
    target: float
    other: str = ""
    raised: bool = False

    @property
    def split(self) -> bool:
        """Whether one file is both."""
        return self.train == self.test


DEVICES = {
    name: Device(**table)
    for name, table in tomllib.loads(
        Path(__file__).with_suffix(".toml").read_text()
    ).items()
}


def prepare_case(device: Device, recordings: Path, case: Path) -> None:
    """Write what is diagnosed of a device into a folder: model.xml and recording.h5."""
    case.mkdir(parents=True, exist_ok=True)
    shutil.copy(recordings / device.model, case / "model.xml")
    if device.raised:
        spec = mujoco.MjSpec.from_file(str(case / "model.xml"))
        for body in spec.bodies:
            if body.name.endswith("_upper"):
                body.pos[2] += HIPS_UP
        (case / "model.xml").write_text(spec.to_xml())
    recording = read(recordings / device.train)
    write(
        _select_every_second(recording, 0) if device.split else recording,
        case / "recording.h5",
    )


def _select_every_second(recording: Recording, first: int) -> Recording:
    """The recording with every second episode only, from the episode `first` on."""
    chosen = list(recording.episodes.items())[first::2]
    return replace(recording, episodes=dict(chosen))


def score_on_test(
    device: Device, recordings: Path, case: Path, program: str
) -> float | None:
    """Score of a diagnosis on the device's test, by `selfheal replay`.

    Returns:
        The normalized error, or None where the replay failed.
    """
    test = read(recordings / device.test)
    if device.split:
        odd = _select_every_second(test, 1)
        test = edit_episodes(odd, lambda e: select_signals(e, ["vertical"]))
    other = ["--model", str((recordings / device.other).resolve())]
    more = other if device.other else []
    return score_replay(case / FOUND, test, (program, "replay"), *more)


def summarize_device(name: str, case: Path, reached: float | None) -> Record:
    """A row of the results: what was found of a device, its score, time and memory.

    Args:
        reached: score on the test, None where the replay failed.
    """
    said = json.loads((case / DOCUMENT).read_text())
    ran = json.loads((case / "run.json").read_text())
    named = []
    for f in said["findings"]:
        numbers = (f"{p['name']} {_format_value(p['value'])}" for p in f["parameters"])
        named.append(f"{f['effect']} {f['target']} ({', '.join(numbers)})")
    return {
        "device": name,
        "target": DEVICES[name].target,
        "reached": reached,
        "verdict": said["verdict"],
        "named": named,
        "seconds": ran["seconds"],
        "megabytes": ran["megabytes"],
    }


def _format_value(value: float | list[float]) -> str:
    if isinstance(value, list):
        return f"({', '.join(map(_format_value, value))})"
    return f"{value:.3g}"


def main() -> int:
    """Prepare the named devices; diagnose and test all that the folder holds."""
    line = make_parser(__doc__ or "")
    line.add_argument("names", nargs="*", metavar="NAME", help=", ".join(DEVICES))
    line.add_argument("--recordings", type=Path, required=True)
    line.add_argument("--out", type=Path, required=True)
    line.add_argument("--jobs", type=int, default=2)
    line.add_argument("--program", default="selfheal")
    options = line.parse_args()
    if wrong := sorted(set(options.names) - set(DEVICES)):
        line.error(f"unknown: {', '.join(wrong)}; known: {', '.join(DEVICES)}")
    for name in options.names or DEVICES:
        if not (options.out / name / "model.xml").is_file():
            prepare_case(DEVICES[name], options.recordings, options.out / name)
    limits = ProcessLimits(3600, (options.program, "diagnose"))
    failed = diagnose_cases(options.out, options.jobs, limits)
    rows = []
    for name, device in DEVICES.items():
        case = options.out / name
        if (case / DOCUMENT).is_file():
            reached = score_on_test(device, options.recordings, case, options.program)
            rows.append(summarize_device(name, case, reached))
    page = Path(__file__).with_name("devices.md")
    publish_page(options.root, "devices", page, {"devices": rows})
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
