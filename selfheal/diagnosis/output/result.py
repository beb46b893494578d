"""The result of a diagnosis: the contract's document, and what a page draws with it."""

import os
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from ...errors import InputError, ModelError
from ...mjcf.edit import Edit, apply_edits
from ...notebook import Columns, format_columns, make_frame, open_axes
from ...printable import join_names, make_printable
from ...recording import Recording, load_model, open_recording
from ...recording.data import Floats
from ..estimation.information import Information
from .actuator_configs import format_isaac_lab, format_mjlab, format_yaml
from .actuators import describe_actuators
from .document import format_document
from .model_source import compile_patched
from .schema import Document
from .storage import URDF, check_folder, write_diagnosis
from .urdf_patch import UrdfPatch, find_urdf

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from pandas import DataFrame


@dataclass(frozen=True, eq=False)
class Trace:
    """One signal in one stretch of a held-out episode, measured and predicted.

    Attributes:
        episode: empty where each of several was read once.
        signal: of a vector signal one column ("cube_position[2]").
        time: (T) [s], or the number of the episode where each was read once.
        read: (T) measured, NaN where missing [unit].
        given, refit, patched: (T) predicted by the model as given, the re-fitted one,
            and the one with the findings [unit].
    """

    episode: str
    signal: str
    unit: str
    time: Floats
    read: Floats
    given: Floats
    refit: Floats
    patched: Floats


@dataclass(frozen=True, eq=False)
class PoseTrace:
    """Poses of all bodies in the worst stretch, measured and predicted.

    Bodies are those of the given model but the world, in its order. A pose is a body's
    origin [m] and quaternion in the world frame; NaN where a model diverged.

    Attributes:
        time: (F) of the frames [s].
        unread: joints without a reading, which move here as the given model moves them.
        measured: (F, B, 7).
        given, patched: (F, B, 7) predicted by the model as given, and with findings.
    """

    episode: str
    time: Floats
    unread: tuple[str, ...]
    measured: Floats
    given: Floats
    patched: Floats


@dataclass(frozen=True, eq=False)
class Localization:
    """Where the re-fitted model is wrong.

    Attributes:
        signals: (S).
        regimes: (R) of the contract.
        share: (S, R) of the squared error that lies there; NaN where the regime was
            hardly seen.
        p_value: (S, R) that it is no larger there than elsewhere, corrected for the
            grid.
    """

    signals: tuple[str, ...]
    regimes: tuple[str, ...]
    share: Floats
    p_value: Floats


@dataclass(frozen=True)
class SignalFit:
    """Normalized error [1] of one signal on held-out episodes, with 90 % intervals.

    Attributes:
        scored: whether it counts in the contract's score.
        given, refit, patched: value, low and high over episodes, of each model.
        floor: what the readings' noise alone leaves.
        unit: of errors that are not normalized.
        scale: what a normalized error of 1 is [unit].
        reads: what it is read at, as a target is named ("joint:knee", "sensor:imu").
    """

    name: str
    scored: bool
    given: tuple[float, float, float]
    refit: tuple[float, float, float]
    patched: tuple[float, float, float]
    floor: float
    unit: str = "1"
    scale: float = 1.0
    reads: str = ""


@dataclass(frozen=True)
class Candidate:
    """A candidate of the search's first round.

    Attributes:
        target: where it acts, as text.
        left: share of the squared error that it alone leaves.
        named: whether it is among the findings.
    """

    effect: str
    target: str
    left: float
    named: bool


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """The result of a diagnosis.

    Attributes:
        model: path of the file that was diagnosed.
        document: diagnosis.json, contract section 2.
        edits: of the model's text, which make it patched.xml.
        patched: text of patched.xml, as it would stand beside the model.
        diff: unified, of the given model's text to the patched one's.
        traces: the worst stretches, worst first.
        located: where the re-fitted model is wrong.
        signals: held-out errors, one for each signal.
        candidates: of the search's first round, best first.
        remarks: sentences a user should read (never excited, not pinned down, ...).
        seconds: that it took [s].
        simulations: how many segments were simulated.
        page: text of report.html; empty where none was drawn.
        more_than_noise: whether the findings leave more than noise in short segments.
        information: what the recordings tell of the values, as of the last fit.
        poses: of all bodies in the worst stretch; None of poses that were read once.
    """

    model: str
    document: Document
    edits: Sequence[Edit]
    patched: str
    diff: str
    traces: tuple[Trace, ...]
    located: Localization
    signals: tuple[SignalFit, ...]
    candidates: tuple[Candidate, ...]
    remarks: tuple[str, ...]
    seconds: float
    simulations: int
    page: str = ""
    more_than_noise: bool = False
    information: Information | None = None
    poses: PoseTrace | None = None

    def with_stop(self, stage: str, count: int, untried: Sequence[str]) -> "Diagnosis":
        """The result of a search that was stopped before its end.

        Args:
            count: of the effects that could be somewhere in the robot.
            untried: names of those of them that were not tried everywhere.
        """
        left = f"; not tried everywhere: {join_names(untried)}" if untried else ""
        remark = f"Stopped before the end, while {stage}: the best answer so far{left}."
        document: Document = {
            **self.document,
            "stopped": {
                "while": stage,
                "tried": count - len(untried),
                "of": count,
                "not_tried": list(untried),
            },
        }
        return replace(self, document=document, remarks=(remark, *self.remarks))

    def save(self, folder: str | os.PathLike[str], *, force: bool = False) -> None:
        """Write the files of a diagnosis (`storage.FILES`), all or nothing.

        Args:
            folder: made where it is missing; meshes and textures still lead from it to
                where they are.
            force: whether an earlier diagnosis there is replaced.

        Raises:
            InputError: the folder cannot be written or would be lost, or the model's
                file has changed since it was diagnosed.
        """
        folder = check_folder(folder, force).resolve()
        given = Path(self.model)
        if apply_edits(given, self.edits, given.resolve().parent) != self.patched:
            raise InputError(
                f"{given} is no longer the model that was diagnosed; diagnose it again"
            )
        texts = {
            "diagnosis.json": format_document(self.document),
            "patched.xml": apply_edits(given, self.edits, folder),
            "patched.diff": self.diff,
            "report.html": self.page,
        }
        texts |= self._write_for_others(folder)
        write_diagnosis(folder, texts, self.information)

    def _write_for_others(self, folder: Path) -> dict[str, str]:
        """Texts of the files that other simulators read, by their names."""
        if self.edits:  # both in the digits of a text, which a URDF becomes
            each = ((), self.edits)
            given, patched = (compile_patched(self.model, e).compile() for e in each)
        else:
            given = patched = load_model(self.model)
        name = os.path.basename(self.model)
        actuators = describe_actuators(given, patched, self.document, name)
        texts = {
            "actuators.yaml": format_yaml(actuators),
            "actuators_isaaclab.py": format_isaac_lab(actuators),
            "actuators_mjlab.py": format_mjlab(actuators),
        }
        if path := find_urdf(self.model):
            with suppress(ModelError):  # a remark says so
                urdf = UrdfPatch(path, given, patched)
                texts[URDF] = urdf.to_text(folder)
                if path == self.model:
                    texts["patched.diff"] = urdf.diff
        return texts

    def simulate(
        self,
        recording: Recording | str | os.PathLike[str],
        *,
        model: str | os.PathLike[str] | None = None,
    ) -> Recording:
        """The signals that this diagnosis predicts, as `selfheal replay` does.

        Args:
            recording: or its path: commands, and the signals to predict. Their
                readings tell where an episode without qpos0 starts, as for a diagnosis;
                else they may all be NaN.
            model: another version of the robot's model to apply the findings to.

        Returns:
            The recording with every signal that a model predicts filled in, open loop.

        Raises:
            RecordingError: nothing tells where an episode starts, or it does not fit
                the model, or makes it diverge.
            InputError: the model lacks what a finding is about.
        """
        from .replay import replay_recording

        recording = open_recording(recording)
        with tempfile.TemporaryDirectory() as room:
            folder = Path(room) / "diagnosis"
            self.save(folder)
            return replay_recording(folder, recording, model=model)

    def to_dataframe(self) -> "DataFrame":
        """The findings as a data frame of pandas, a row for each parameter.

        Raises:
            InputError: pandas is not installed.
        """
        return make_frame(self._list_findings())

    def plot(self, trace: int = 0, *, ax: "Axes | None" = None) -> "Axes":
        """Draw a stretch of a held-out episode, measured and predicted.

        Args:
            trace: number among `traces`, the worst one first.
            ax: to draw on; None makes a figure of matplotlib's pyplot.

        Raises:
            InputError: there is no such stretch.
        """
        if not 0 <= trace < len(self.traces):
            raise InputError(f"no trace {trace}; there are {len(self.traces)}, from 0")
        shown, ax = self.traces[trace], open_axes(ax)
        ax.plot(shown.time, shown.read, color="0.6", lw=3, label="measured")
        for name in ("given", "refit", "patched"):
            ax.plot(shown.time, getattr(shown, name), label=name)
        ax.set_xlabel("time [s]" if shown.episode else "episode")
        ax.set_ylabel(f"{shown.signal} [{shown.unit}]")
        ax.legend()
        return ax

    def __repr__(self) -> str:
        named = [f"{f['effect']} at {f['target']}" for f in self.document["findings"]]
        said = f"<{self._describe()}; findings: {join_names(named) or 'none'}>"
        return make_printable(said)

    def _repr_html_(self) -> str:
        fit = self.document["fit"]
        errors = {key: [fit.get(key)] for key in ("given", "refit", "patched", "floor")}
        return format_columns(self._describe(), self._list_findings()) + format_columns(
            "Normalized error on held-out episodes", errors
        )

    def _describe(self) -> str:
        """What it is, in a line."""
        return f"Diagnosis of {self.model}: {self.document['verdict']}"

    def _list_findings(self) -> Columns:
        """A row for each parameter of each finding; one for a finding without."""
        keys = ("name", "value", "low", "high", "unit")
        rows = [
            (finding["effect"], finding["target"], *map(parameter.get, keys))
            for finding in self.document["findings"]
            for parameter in [dict(p) for p in finding["parameters"]] or [{}]
        ]
        head = ("effect", "target", "parameter", *keys[1:])
        return {name: [row[k] for row in rows] for k, name in enumerate(head)}
