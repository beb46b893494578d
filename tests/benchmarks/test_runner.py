"""The one runner and the one writer: suites go on, and pages show every figure."""

from functools import partial

import jinja2
import pytest

from benchmarks import suites, writer
from benchmarks.suites import complete_suite, read_records
from benchmarks.writer import format_fixed, format_hits, place_part, publish_page


@pytest.fixture
def results(monkeypatch, tmp_path):
    monkeypatch.setattr(suites, "RESULTS", tmp_path)
    return tmp_path


def _square(k):
    return {"square": k * k}


def _fail():
    raise KeyboardInterrupt


def test_an_interrupted_suite_goes_on(results):
    runs = {"1": partial(_square, 1), "2": _fail, "3": partial(_square, 3)}
    with pytest.raises(KeyboardInterrupt):
        complete_suite("it", runs.items())
    assert list(read_records("it")) == ["1"]
    runs |= {"1": _fail, "2": partial(_square, 2)}  # the first is not done again
    found = complete_suite("it", runs.items())
    assert [r["square"] for r in found.values()] == [1, 4, 9]
    assert read_records("it").keys() == runs.keys()


@pytest.mark.slow
def test_processes_give_the_same_records(results):
    runs = {str(k): partial(_square, k) for k in range(4)}
    found = [complete_suite(f"{n}", runs.items(), n) for n in (1, 2)]
    squares = [{key: r["square"] for key, r in records.items()} for records in found]
    assert squares[0] == squares[1]


def test_a_page_has_its_command_and_every_figure(tmp_path, monkeypatch):
    monkeypatch.setattr(writer.sys, "argv", ["x", "--root", "here", "page"])
    template = tmp_path / "page.md"
    template.write_text("# {{ name }}\n\n{{ table(('a', 'b'), rows) }}\n")
    publish_page(tmp_path, "p", template, {"name": "Title", "rows": [(1, 2)]})
    title, command, *_ = (tmp_path / "docs/results/p.md").read_text().split("\n\n")
    assert title == "# Title" and command.endswith(" page")
    assert "| 1 | 2 |" in (tmp_path / "docs/results/p.md").read_text()
    assert len(list((tmp_path / "benchmarks/results").glob("p-*.json"))) == 1
    with pytest.raises(jinja2.UndefinedError):
        publish_page(tmp_path, "p", template, {"name": "Title"})


def test_a_part_of_a_page_is_written_anew_in_its_place(tmp_path):
    page = tmp_path / "all.md"
    page.write_text("# All\n\n<!-- begin p -->\n\nold\n\n<!-- end p -->\n\n## Rest\n")
    found, text = place_part(tmp_path, "p", "# New\n\n## Figures\n")
    place = "<!-- begin p -->\n\n## New\n\n### Figures\n\n<!-- end p -->\n"
    assert (found, text) == (page, f"# All\n\n{place}\n## Rest\n")
    assert place_part(tmp_path, "q", "# Own\n") == (tmp_path / "q.md", "# Own\n")


def test_numbers_are_written_the_same_on_all_pages():
    assert [format_fixed(1234.5, 0), format_fixed(0.126), format_fixed(None)] == [
        "1,234",
        "0.13",
        "",
    ]
    assert format_hits([1, 0, True]).startswith("2/3 = 66.7 %")
