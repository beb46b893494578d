"""The report page: whole, escaped, silent in a browser, with every picture drawn."""

import html
import json
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from selfheal.body.body import Anatomy
from selfheal.body.genome import build_bodies, draw_genomes
from selfheal.report import facts, picture
from selfheal.report.draw import (
    Camera,
    _build_cube,
    _build_prism,
    _compute_normals,
    look_from_behind,
    measure_window,
)
from selfheal.report.identify import make_identify_page
from selfheal.report.page import Html, Section, make_page, make_table, write_page
from selfheal.selfmodel.run import Cycle, Run, Settings

HOSTILE = '<script>alert(1)</script>&"'
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")


def _anatomy(parts: int) -> Anatomy:
    block = (np.arange(parts) % 2)[:, None]
    return Anatomy(
        name="toy",
        parts=tuple(f"part_{i}" for i in range(parts)),
        joints=tuple(f"joint_{i}" for i in range(parts)),
        torso_half=np.array([0.04, 0.05, 0.03]),
        torso_mass=0.5,
        rim=np.array([0.06, 0.07, 0.0]),
        length=np.linspace(0.08, 0.12, parts),
        radius=np.full(parts, 0.008),
        mass=np.full(parts, 0.1),
        block_half=block * np.array([0.02, 0.015, 0.02]),
        block_center=0.02 * block[:, 0],
        block_mass=0.02 * block[:, 0],
        feet=(parts,),
    )


def _run(
    *,
    parts: int = 3,
    cycles: int = 4,
    rivals: int = 5,
    truth: bool = True,
    seed: int = 0,
) -> Run:
    """A finished run with made up numbers."""
    rng = np.random.default_rng(seed)
    anatomy, count = _anatomy(parts), max(cycles, 6)
    actions = np.where(rng.random((count, parts)) < 0.3, -0.5, 0.5)
    hidden = build_bodies(anatomy, draw_genomes(anatomy, 1, rng, False))
    run = Run(
        Settings("toy", cycles=max(cycles, 1)),
        anatomy,
        actions,
        truth=hidden if truth else None,
        counts={"statics": 1000, "choice": 20, "failed": 0},
        result={"format": "made up"},
    )
    for k in range(cycles):
        tables = rng.normal(0, 5, (rivals, count, 3))
        cycle = Cycle(
            action=k,
            why="made up",
            felt=tables[0, k] + rng.normal(0, 0.3, 3),
            genomes=draw_genomes(anatomy, rivals, rng, False),
            tables=tables,
            losses=np.sort(rng.uniform(0, 2, rivals)),
            sureness=rng.random(parts),
            tilt_error=float(rng.random()),
            disagreement=float(rng.random()),
            spent=250 * (k + 1),
            seconds=1.5 * (k + 1),
        )
        run = run.with_cycle(cycle)
    return run


def _hostile(run: Run) -> Run:
    """The same run with names that try to break out of the page."""
    names = [HOSTILE, "$\\frac{x$ --> \n\x07\u811a\ud800", *"abcdefghijklmnop"]
    names = tuple(names[: run.anatomy.size])
    anatomy = replace(run.anatomy, name=HOSTILE, parts=names, joints=names)
    settings = replace(run.settings, robot=HOSTILE, recordings=HOSTILE)
    cycles = tuple(replace(c, why=HOSTILE) for c in run.cycles)
    truth = None if run.truth is None else replace(run.truth, anatomy=anatomy)
    return replace(run, anatomy=anatomy, settings=settings, cycles=cycles, truth=truth)


def _last(run: Run, **changes) -> Run:
    return replace(run, cycles=(*run.cycles[:-1], replace(run.cycles[-1], **changes)))


def _words(markup: str) -> str:
    """What a reader reads."""
    bare = re.sub(r"<(style|svg).*?</\1>", " ", markup, flags=re.DOTALL)
    return " ".join(html.unescape(re.sub(r"<[^>]*>", " ", bare)).split())


# ---- the page builder


def test_everything_but_markup_is_escaped():
    body = make_table([HOSTILE], [[HOSTILE]], "l")
    made = make_page(HOSTILE, [Section(HOSTILE, (HOSTILE, body))], lead=HOSTILE)
    assert "<script" not in made
    assert made.count(html.escape(HOSTILE)) == 7  # the title stands twice
    assert "<b>x</b>" in make_page("", [Section("", (Html("<b>x</b>"),))], lead="")


def test_a_page_is_written_whole(tmp_path):
    write_page("\u811a", tmp_path / "report.html")
    assert (tmp_path / "report.html").read_text(encoding="utf-8") == "\u811a"
    assert len(list(tmp_path.iterdir())) == 1


def test_names_from_a_file_come_out_escaped():
    made = make_identify_page(_hostile(_run()))
    assert "<script" not in made and "alert(1)" in made
    assert f"<td>{html.escape(HOSTILE)}</td>" in made
    made.encode("utf-8")


def test_a_picture_that_is_large_as_svg_is_a_png(monkeypatch):
    monkeypatch.setattr(picture, "_LARGEST_SVG", 1000)
    made = make_identify_page(_run())
    assert "<svg" not in made and made.count('src="data:image/png;base64,') == 5


# ---- what it says


def test_the_page_says_what_was_inferred_and_how_far_off_it_is():
    run = _run()
    body = build_bodies(run.anatomy, run.cycles[-1].genomes[:1])
    words = _words(make_identify_page(run))
    correct = int((body.parent == run.truth.parent).sum())
    assert f"with {correct} of 3 attachments correct" in words
    for name, value in facts.list_errors(run, body):
        assert f"{name} {value}" in words
    assert words.count(" wrong: ") == 3 - correct
    assert "not finished" not in words and "on statics 1,000" in words


def test_a_run_without_truth_calls_nothing_wrong():
    words = _words(make_identify_page(_run(truth=False)))
    assert "Nobody knows the true body" in words
    assert "wrong:" not in words and "attachments correct" not in words


def test_an_unfinished_run_says_so():
    run = _run(cycles=4)
    run = replace(run, result={}, settings=replace(run.settings, cycles=16))
    assert "not finished: 4 of 16 actions so far" in _words(make_identify_page(run))


def test_a_run_that_has_not_begun_has_a_page():
    run = replace(_run(cycles=0), result={})
    words = _words(make_identify_page(run))
    assert "No action has been tried yet" in words and "Settings" in words


@pytest.mark.parametrize("parts", [1, 2, 12])
def test_robots_of_other_sizes_have_a_page(parts):
    assert make_identify_page(_run(parts=parts)).count("<svg") == 5


def test_one_cycle_with_one_rival_has_a_page():
    words = _words(make_identify_page(_run(cycles=1, rivals=1)))
    assert "Candidates kept: 1." in words and "After 1 action and" in words


def test_the_first_sentence_has_the_tilt_error_of_the_result():
    run = _run()
    done = replace(run, result={"tilt_error": 43.21})
    assert "measured tilts to 43.21 degrees" in _words(make_identify_page(done))
    unfinished = _last(replace(run, result={}), tilt_error=12.34)
    assert "measured tilts to 12.34 degrees" in _words(make_identify_page(unfinished))


def test_missing_readings_and_diverged_rivals_have_a_page():
    run = _run()
    last = run.cycles[-1]
    cycles = [replace(c, felt=c.felt * [1, 1, np.nan]) for c in run.cycles]
    run = _last(
        replace(run, cycles=tuple(cycles)),
        sureness=np.full(3, np.nan),
        tables=np.full_like(last.tables, np.nan),
        losses=np.full_like(last.losses, np.inf),
        tilt_error=np.nan,
        disagreement=np.nan,
    )
    words = _words(make_identify_page(run))
    assert "clearance" not in words and "nan" not in words
    assert "clearance" in _words(make_identify_page(_run()))


def test_hinges_are_named_where_they_are_unknown():
    run = _run()
    full = replace(run, settings=replace(run.settings, space="full"))
    assert "hinge" in _words(make_identify_page(full))
    assert "hinge" not in _words(make_identify_page(run))


def test_rivals_are_those_that_the_data_do_not_rule_out():
    run = _run(rivals=4)
    best = run.cycles[-1].genomes[:1]
    genomes = best[np.zeros(4, int)]
    genomes.placement[1, 2] = (best.placement[0, 2] + 0.5) % 1
    genomes.length[2, 2] += 0.01
    losses = 4 * np.array([1.0, 1.05, 1.4, 1.6])  # of four actions
    found = facts.list_rivals(_last(run, genomes=genomes, losses=losses))
    assert [r.rank for r in found] == [1, 2, 3]
    side = facts.SIDES[genomes.side[1, 2]]
    assert [r.differs for r in found] == [
        (),
        (f"part_2 on the {side} side",),
        ("part_2 +10 mm long",),
    ]
    assert found[0].away == found[0].apart == 0 and found[1].away > 1


def test_the_side_of_a_body_is_that_of_its_genome():
    anatomy = _anatomy(8)
    genomes = draw_genomes(anatomy, 200, np.random.default_rng(0), False)
    np.testing.assert_array_equal(
        facts.find_true_side(build_bodies(anatomy, genomes)), genomes.side
    )


@pytest.mark.parametrize(
    "count, said",
    [(0, "0"), (999, "999"), (1000, "1k"), (16_375, "16.4k"), (999_499, "999k"),
     (999_500, "1M"), (1_250_000, "1.25M")],
)  # fmt: skip
def test_numbers_on_an_axis_are_short(count, said):
    assert facts.format_thousands(count) == said


# ---- drawings


@pytest.mark.parametrize(
    "solid, volume", [(_build_cube(), 8), (_build_prism(), 3 * 3**0.5 / 2)]
)
def test_a_solid_is_closed_and_faces_outward(solid, volume):
    normals = _compute_normals(solid)
    np.testing.assert_allclose(normals.sum(axis=0), 0, atol=1e-12)
    # divergence theorem: the normals are twice the faces' areas
    assert (solid[:, 0] * normals).sum() / 6 == pytest.approx(volume)


def test_a_camera_from_behind_and_above_sees_forward_as_up_and_left_as_left():
    camera = Camera(np.pi, 1.0, 2.0)
    np.testing.assert_allclose(camera.axes @ camera.axes.T, np.eye(3), atol=1e-12)
    right, up, _ = camera.project(np.eye(3)).T
    assert up[0] > 0 and abs(right[0]) < 1e-12  # forward
    assert right[1] < 0 and up[2] > 0  # left, up


def test_a_window_grows_with_the_bodies():
    anatomy = _anatomy(5)
    genomes = draw_genomes(anatomy, 9, np.random.default_rng(3), False)
    bodies = build_bodies(anatomy, genomes)
    camera = look_from_behind(bodies)
    whole = measure_window(bodies, camera)
    single = [measure_window(bodies[k : k + 1], camera) for k in range(9)]
    np.testing.assert_allclose(np.max(single, axis=0), whole)
    assert look_from_behind(bodies).distance > 2 * whole.max()


def test_up_to_eight_cycles_are_drawn_with_the_first_and_the_last():
    from selfheal.report.figures import choose_cycles

    assert choose_cycles(1) == [0] and choose_cycles(3) == [0, 1, 2]
    for count in (8, 9, 16, 36, 500):
        shown = choose_cycles(count)
        assert len(shown) == 8 and shown[0] == 0 and shown[-1] == count - 1


# ---- in a browser

_MEASURE = """<script>
document.body.dataset.pictures = JSON.stringify(
  [...document.querySelectorAll("figure > svg")].map(svg => {
    const box = svg.getBoundingClientRect();
    return [box.x, box.y, box.width, box.height].map(Math.round);
  }));
</script>"""


@pytest.fixture
def browse(tmp_path):
    """Open a page in headless Chromium: path and options in, stdout and log out."""
    if CHROMIUM is None:
        pytest.skip("no chromium to open the page with (Debian: apt install chromium)")

    def run(path: Path, *options: str) -> tuple[str, str]:
        command = [
            CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run",
            "--disable-background-networking", "--disable-component-update",
            "--disable-sync", "--disable-dev-shm-usage", "--hide-scrollbars",
            f"--user-data-dir={tmp_path / 'profile'}", "--window-size=1200,6000",
            "--host-resolver-rules=MAP * ~NOTFOUND", "--enable-logging=stderr", "--v=0",
            *options, path.as_uri(),
        ]  # fmt: skip
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=120, check=True
        )
        return done.stdout, done.stderr

    return run


def _console(log: str) -> list[str]:
    return [line for line in log.splitlines() if "CONSOLE" in line]


@pytest.mark.parametrize(
    "run", [_run(), _hostile(_run(truth=False))], ids=["plain", "x"]
)
def test_a_browser_finds_no_error_and_every_picture_drawn(run, browse, tmp_path):
    from matplotlib.image import imread

    made = make_identify_page(run)
    path, shot = tmp_path / "report.html", tmp_path / "shot.png"
    write_page(made, path)
    _, log = browse(path, f"--screenshot={shot}")
    assert _console(log) == []
    # where the pictures are, from a copy that may run a script
    free = re.sub(r'<meta http-equiv="Content-Security-Policy"[^>]*>', "", made)
    (tmp_path / "free.html").write_text(free.replace("</body>", _MEASURE + "</body>"))
    dom, log = browse(tmp_path / "free.html", "--dump-dom")
    assert _console(log) == []
    found = re.search(r'data-pictures="([^"]*)"', dom)
    boxes = json.loads(html.unescape(found.group(1)))
    assert len(boxes) == made.count("<svg") == 5
    pixels = imread(shot)[..., :3]
    for x, y, wide, high in boxes:
        assert wide > 900 and high > 80
        seen = pixels[y : y + high, x : x + wide]
        assert seen.shape[:2] == (high, wide)
        drawn = (np.abs(seen - seen[0, 0]).max(axis=2) > 0.1).mean()
        assert 0.005 < drawn < 0.9


def test_the_check_in_a_browser_sees_errors_and_requests(browse, tmp_path):
    path = tmp_path / "report.html"
    picture = Html('<img src="https://example.com/x.png">')
    write_page(make_page("", [Section("", (picture,))], lead=""), path)
    _, log = browse(path, f"--screenshot={tmp_path / 'shot.png'}")
    assert any("Content Security Policy" in line for line in _console(log))


def test_the_page_asks_for_nothing_from_anywhere():
    made = make_identify_page(_run())
    addresses = re.findall(r'\b(?:src|href|action|data|poster)="([^"]*)"', made)
    addresses += re.findall(r"url\(([^)]*)\)", made)
    assert [a for a in addresses if not a.startswith(("#", "data:"))] == []
    assert "@import" not in made and "<script" not in made
    names = re.sub(r'xmlns(:\w+)?="[^"]*"', "", made)
    assert "http:" not in names and "https:" not in names and "//" not in names


def test_a_long_run_stays_below_five_megabytes():
    made = make_identify_page(_run(parts=8, cycles=36, rivals=16))
    assert len(made.encode()) < 5_000_000
