"""`diagnose`, `replay`, `effects`: JSON, files, tables; refusals before any work."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from selfheal.diagnosis.output.storage import FILES
from selfheal.recording import read, shorten_names, write
from selfheal.telemetry import Fault
from tests.support.commands.run import refuse, run, run_well
from tests.support.made_up_diagnosis import make_diagnosis

pytestmark = pytest.mark.usefixtures("undrawn")


def _names(folder) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


# ---- diagnose


def test_json_is_the_document_and_nothing_else(doctor, files, tmp_path):
    out = tmp_path / "out"
    words = "diagnose", *files, "--out", out, "--seed", "3", "--findings-only"
    result = run(*words, "--json")
    assert result.exit_code == 0, result.output
    assert result.stderr == "" and result.stdout.count("\n") == 1
    told = json.loads(result.stdout)
    assert told == {**doctor.answer.document, "seconds": 41.2, "folder": str(out)}
    assert doctor.asked[0]["files"] == [str(file) for file in files[1:]]
    assert doctor.asked[0]["seed"] == 3 and doctor.asked[0]["held_out"] == []
    assert doctor.asked[0]["findings_only"]
    assert _names(out) == sorted(FILES)
    page = (out / "report.html").read_text()
    assert "Diagnosis of arm.xml" in page and str(files[2]) in page


def test_a_log_that_contradicts_the_model_is_refused_unless_let_pass(
    doctor, files, tmp_path, monkeypatch
):
    mend = "signals.q.scale = -1"
    odd = Fault("sign", ("a",), ("q",), "j", "q is flipped", 1e-9, "a test", (mend,))
    wide = replace(odd, kind="joint_range", seen="q is far")
    monkeypatch.setattr("selfheal.telemetry.check_telemetry", lambda *_: [odd, wide])
    arguments = ("diagnose", *files, "--out", tmp_path / "out")
    message = refuse(*arguments)
    assert "q is flipped" in message and mend in message and "q is far" not in message
    result = run_well(*arguments, "--no-check", "sign")
    assert "q is far" in result
    assert "q is far" in (tmp_path / "out" / "report.html").read_text()
    assert "joint_range" in refuse(*arguments, "--force", "--no-check", "x")


def test_progress_goes_to_stderr_and_the_tables_to_stdout(doctor, files, tmp_path):
    result = run("diagnose", *files, "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    said = " ".join(result.stdout.split())
    said_words = (
        *("things differ from the model", "coulomb_friction", "joint:knee", "0.14 N m"),
        "cannot be distinguished from stribeck_friction by these",
        "1.9 deg as given, 0.31 deg patched (noise 0.10 deg)",
        *("4.56 times", "to separate them: move the joint by hand", "29 deg/s"),
        *("0.21", "95 %", "note: The hip never", "report.html"),
    )
    for word in said_words:
        assert word in said, word
    assert result.stderr.count("s  trying every effect") == 1  # one stage
    assert not doctor.asked[0]["findings_only"]
    assert "trying" not in result.stdout


@pytest.mark.parametrize("verdict", ["nothing", "unlisted", "undecided"])
def test_a_diagnosis_without_findings_is_printed(verdict, doctor, files, tmp_path):
    answer = make_diagnosis(verdict, ())
    fit = answer.document["fit"] | {"floor": None, "explainable_removed": None}
    doctor.answer = replace(answer, document={**answer.document, "fit": fit})
    result = run_well("diagnose", *files, "--out", tmp_path / "out")
    assert "held-out error" in result and "joint:knee" not in result


@pytest.mark.parametrize(
    ("held_out", "found"),
    [
        (["fa/r.h5:zeta"], ["fa/r.h5:zeta"]),
        (["./fb/r.h5:zeta"], ["fb/r.h5:zeta"]),
        (["{}/fb/r.h5:zeta"], ["fb/r.h5:zeta"]),
        (["fa/../fb/r.h5:zeta"], ["fb/r.h5:zeta"]),
        (["c.hdf5:alpha", "fa/r.h5:zeta"], ["c.hdf5:alpha", "fa/r.h5:zeta"]),
        (["c.hdf5"], ["c.hdf5:zeta", "c.hdf5:alpha"]),
    ],
)
def test_an_episode_or_a_file_is_held_out(
    held_out, found, doctor, files, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    for name in ("fa/r.h5", "fb/r.h5", "c.hdf5"):
        Path(name).parent.mkdir(exist_ok=True)
        write(read(files[1]), name)
    given = [w for one in held_out for w in ("--held-out", one.format(tmp_path))]
    run_well("diagnose", files[0], "fa/r.h5", "fb/r.h5", "c.hdf5", *given, "--out", "o")
    assert doctor.asked[0]["held_out"] == found
    names = ["fa/r.h5", "fb/r.h5", "x.h5"]
    assert shorten_names(names) == names


BAD = [
    (["no.xml", "a.h5"], "no.xml: there is no such file"),
    (["arm.xml", "no.h5"], "no.h5: there is no such file"),
    (["arm.xml", "a.h5", "a.h5"], "a.h5 is given twice"),
    (["arm.xml", "a.h5", "./b.h5", "b.h5"], "b.h5 is given twice"),
    (["arm.xml", "arm.xml"], "arm.xml: it is no HDF5 file"),
    (["arm.xml", "a.h5", "--seed", "-1"], "seed must not be negative"),
    (["arm.xml", "a.h5", "--out", "b.h5"], "b.h5 is a file"),
    (["arm.xml", "a.h5", "--out", "/proc/x/y"], "cannot write"),
    (["arm.xml", "a.h5", "--out", "x" * 300], "name too long"),
    (["arm.xml", "no.h5", "--out", "new/folder/out"], "no.h5: there is no such file"),
    (["arm.xml", "a.h5", "--out", "x" * 245], "name too long"),
    (["arm.xml", "a.h5", "--out", "x/" * 3000], "name too long"),
    (["arm.xml", "a.h5", "--out", "loop"], "levels of symbolic links"),
    (["x" * 300, "a.h5"], "cannot be read: File name too long"),
    (["loop", "a.h5"], "loop: it cannot be read: Too many levels"),
    (["arm.xml", "x" * 300], "cannot be read: File name too long"),
    (["arm.xml", "/tmp"], "/tmp: it is a folder"),
    (["arm.xml", "/dev/null"], "/dev/null: it is no regular file"),
    (["arm.xml", "a.h5/b.h5"], "a.h5/b.h5: there is no such file"),
    ([".", "a.h5"], ".: it is a folder"),
    (["arm.xml", "a.h5", "--out", "."], "no part of a diagnosis"),
    (["arm.xml", "a.h5", "--out", ".", "--force"], "no part of a diagnosis"),
    (["arm.xml", "a.h5", "--out", "b.h5/x/y"], "b.h5 is a file"),
    (["arm.xml", "a.h5", "b.h5", "--held-out", "zeta"], "a.h5:zeta, b.h5:zeta"),
]


@pytest.mark.parametrize("arguments, said", BAD, ids=[" ".join(a)[:40] for a, _ in BAD])
def test_bad_input_is_refused_before_any_work(
    arguments, said, doctor, files, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "loop").symlink_to("loop")
    before = _names(tmp_path)
    out = [] if "--out" in arguments else ["--out", "out"]
    for extra in ([], ["--json"]):
        assert said in refuse("diagnose", *arguments, *out, *extra)
    assert doctor.asked == [] and _names(tmp_path) == before


def test_without_a_folder_there_is_one_below_runs(doctor, files, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    name = f"runs/diagnose-{Path(files[0]).stem}"
    for folder in (name, f"{name}.2"):
        assert f"{folder}/diagnosis.json" in run("diagnose", *files).stdout
        assert (tmp_path / folder / "report.html").is_file()
    assert "--resume needs --out" in refuse("diagnose", *files, "--resume")


def test_an_earlier_diagnosis_is_overwritten_by_force_only(doctor, files, tmp_path):
    out = ["--out", tmp_path / "out"]
    assert run("diagnose", *files, *out).exit_code == 0
    doctor.answer = make_diagnosis("nothing", ())
    assert "--force" in refuse("diagnose", *files, *out)
    assert run("diagnose", *files, *out, "--force").exit_code == 0
    document = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert document["verdict"] == "nothing"


def test_the_folder_one_stands_in_is_taken_and_stays(
    doctor, files, tmp_path, monkeypatch
):
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    for extra in ([], ["--force"]):
        run_well("diagnose", *files, "--out", ".", *extra)
        assert _names(Path()) == sorted(FILES)
    assert _names(tmp_path) == ["a.h5", "arm.xml", "b.h5", "here"]


@pytest.mark.parametrize("error, code", [(KeyboardInterrupt(), 130), (OSError(), 1)])
def test_a_broken_off_diagnosis_leaves_only_what_it_resumes_from(
    error, code, doctor, files, tmp_path
):
    answer, doctor.answer, before = doctor.answer, error, _names(tmp_path)
    words = ["diagnose", *files, "--out", tmp_path / "out"]
    result = run(*words)
    assert result.exit_code == code
    assert ("--resume goes on" in result.stderr) == (code == 130)
    assert set(_names(tmp_path)) - set(before) == {doctor.memory.name}
    doctor.answer = answer
    assert run(*words, "--resume").exit_code == 0
    assert doctor.found == ["answer"]
    assert set(_names(tmp_path)) - set(before) == {"out"}
    doctor.answer = error
    run(*words, "--force")
    doctor.answer = answer
    assert run(*words, "--force").exit_code == 0  # without --resume it begins anew
    assert doctor.found == []
    result = run(*words, "--force", "--resume")
    assert result.exit_code == 0
    assert "from the beginning" in " ".join(result.stderr.split())


def test_the_first_interrupt_asks_for_the_answer_and_the_second_ends(
    doctor, files, tmp_path, heeded_interrupts
):
    words = ["diagnose", *files, "--out", tmp_path / "out"]
    assert run(*words).exit_code == 0 and not doctor.is_over
    doctor.interrupts = 1
    result = run(*words, "--force")
    assert result.exit_code == 0 and doctor.is_over
    assert "once more" in result.stderr
    doctor.interrupts = 2
    assert run(*words, "--force").exit_code == 130


def test_the_answer_is_asked_for_when_the_minutes_are_over(doctor, files, tmp_path):
    words = ["diagnose", *files, "--out", tmp_path / "out", "--minutes"]
    for none in (0, -1, "nan"):
        assert "more than 0" in refuse(*words, none)
    assert run(*words, "1e-9").exit_code == 0 and doctor.is_over


# ---- replay


@pytest.fixture
def diagnosed(doctor, files, tmp_path):
    """The folder of a diagnosis."""
    assert run("diagnose", *files, "--out", tmp_path / "out").exit_code == 0
    doctor.asked.clear()
    return tmp_path / "out"


def test_replay_writes_a_recording(doctor, diagnosed, files, tmp_path):
    model, a, _ = files
    out = tmp_path / "predicted.h5"
    result = run("replay", diagnosed, a, "--out", out, "--model", model, "--json")
    assert result.exit_code == 0, result.output
    told = json.loads(result.stdout)
    assert result.stderr == "" and told.pop("seconds") >= 0
    head = {"format": "selfheal-replay", "version": 1, "episodes": 2, "samples": 17}
    paths = {"diagnosis": diagnosed, "model": model, "inputs": a, "predicted": out}
    assert told == head | {name: str(path) for name, path in paths.items()}
    assert doctor.asked == [{"folder": diagnosed, "file": str(a), "model": model}]
    assert set(read(out).episodes) == {"zeta", "alpha"}
    again = run_well("replay", diagnosed, a, "--out", out)  # over an earlier one
    assert "samples predicted in" in again


def test_replay_refuses_before_any_work(doctor, diagnosed, files, tmp_path):
    model, a, b = files
    good = tmp_path / "predicted.h5"
    bad = [
        ([tmp_path, a, "--out", good], "is no diagnosis: it has no diagnosis.json"),
        ([diagnosed, "no.h5", "--out", good], "no.h5: there is no such file"),
        ([diagnosed, model, "--out", good], "it is no HDF5 file"),
        ([diagnosed, a, "--out", a], "would overwrite"),
        ([diagnosed, a, "--out", diagnosed / "patched.xml"], "would overwrite"),
        ([diagnosed, a, "--out", a, "--force"], "would overwrite"),
        ([diagnosed, a, "--out", b], "b.h5 is there already; --force replaces it"),
        ([diagnosed, a, "--out", tmp_path], "it is a folder"),
        ([diagnosed, a, "--out", "x" * 245], "name too long"),
        ([diagnosed, a, "--out", "/dev/null", "--force"], "it is no regular file"),
        (["x" * 300, a, "--out", good], "is no diagnosis"),
        ([diagnosed, a, "--out", "/proc/x/p.h5"], "cannot write"),
        (
            [diagnosed, a, "--out", good, "--model", "no.xml"],
            "no.xml: there is no such",
        ),
    ]
    before = _names(tmp_path)
    for arguments, said in bad:
        assert said in refuse("replay", *arguments)
    assert doctor.asked == [] and _names(tmp_path) == before


# ---- effects


@pytest.fixture
def effects(monkeypatch):
    """A catalogue of two."""
    from selfheal.diagnosis import effects
    from selfheal.diagnosis.effects.friction import CoulombFriction, ViscousFriction

    both = {e.name: e for e in (CoulombFriction(), ViscousFriction())}
    monkeypatch.setattr(effects, "load_catalogue", lambda: both)
    return both


def test_effects_are_listed(effects):
    table = run_well("effects")
    for word in (*effects, "friction", "torque", "tau", "equation"):
        assert word in table
    told = json.loads(run("effects", "--json").stdout)
    assert (told["format"], told["version"]) == ("selfheal-effects", 1)
    assert [effect["name"] for effect in told["effects"]] == [*effects]
    keys = {"name", "group", "says", "equation", "source", "separate_by"}
    assert all(set(e) == keys and all(e.values()) for e in told["effects"])
