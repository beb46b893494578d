"""Laws of the pages in docs/ that need no mkdocs; `mkdocs build --strict` has more."""

import importlib.util
import re

import pytest

from tests.support.paths import DOCS, ROOT

PAGES = sorted(p.relative_to(ROOT).as_posix() for p in DOCS.rglob("*.md"))
LONGEST = {"decisions.md": 40, "how-diagnose-works.md": 100}  # lines
HASH = re.compile(r"\b(?=[a-f]*\d)(?=\d*[a-f])[0-9a-f]{7,40}\b")


def _nav() -> list[str]:
    """Pages that mkdocs.yml puts in the navigation, below docs/."""
    _, _, nav = (ROOT / "mkdocs.yml").read_text().partition("\nnav:\n")
    return re.findall(r"[\w/-]+\.md", nav)


def _reference() -> dict[str, list[str]]:
    """Modules on each page of the reference, as its generator lists them."""
    spec = importlib.util.spec_from_file_location("hooks", DOCS / "site_hooks.py")
    hooks = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(hooks)
    return hooks.list_modules()


def _terms() -> list[list[str]]:
    """The cells of each term of the glossary."""
    lines = (DOCS / "glossary.md").read_text().splitlines()
    rows = [line.strip("| ").split(" | ") for line in lines if line.startswith("| ")]
    return [row for row in rows if row[0] not in ("term", "---")]


def test_every_page_is_in_the_navigation_once():
    assert sorted(f"docs/{page}" for page in _nav()) == PAGES


@pytest.mark.parametrize("page", [*PAGES, "README.md", "CONTRIBUTING.md"])
def test_links_between_pages_lead_somewhere(page):
    for link in re.findall(r"\]\(([^)#\s]+)[^)]*\)", (ROOT / page).read_text()):
        if "://" not in link:
            assert ((ROOT / page).parent / link).exists(), link


@pytest.mark.parametrize("page", PAGES)
def test_no_page_is_a_diary(page):
    text = (ROOT / page).read_text()
    assert not re.search(r"\bsittings?\b", text)
    rows = [line for line in text.splitlines() if line.startswith("|")]
    assert not [row for row in rows if HASH.search(row)]


@pytest.mark.parametrize("page", sorted(LONGEST))
def test_a_page_to_read_at_once_is_short(page):
    assert len((DOCS / page).read_text().splitlines()) <= LONGEST[page]


def test_every_public_module_is_in_the_reference():
    parts = [
        p.relative_to(ROOT).with_suffix("").parts for p in ROOT.glob("selfheal/**/*.py")
    ]
    public = {
        ".".join(p).removesuffix(".__init__")
        for p in parts
        if not any(x.startswith("_") for x in p if x != "__init__")
    }
    listed = [module for modules in _reference().values() for module in modules]
    assert sorted(listed) == sorted(public)


def test_a_term_has_one_entry_with_all_its_cells():
    terms = [row[0] for row in _terms()]
    assert sorted(terms) == sorted(set(terms)) and len(terms) > 50
    assert {len(row) for row in _terms()} == {4}


def test_the_code_of_a_term_exists():
    for term, _, code, _ in _terms():
        module, _, name = code.strip("`").rpartition(".")
        path = ROOT / "selfheal" / f"{module.replace('.', '/')}.py"
        assert path.is_file(), f"{term}: {code}"
        assert re.search(rf"^(class|def) {name}\b", path.read_text(), re.M), code
