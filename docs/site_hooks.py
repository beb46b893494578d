"""Hooks of the site: the API reference from the packages, equations as MathML.

MathML needs neither a script nor a network in the browser. `list_modules` imports
nothing of mkdocs, for a test asks it too.
"""

import html
import re
from pathlib import Path

ROOT = Path(__file__).parent.parent
PACKAGE = "selfheal"
EQUATION = re.compile(
    r'<(span|div) class="arithmatex">\\[([](.*?)\\[)\]]</\1>', flags=re.S
)


def list_modules() -> dict[str, list[str]]:
    """Public modules of each public package, by the package's full name."""
    pages: dict[str, list[str]] = {}
    for path in sorted((ROOT / PACKAGE).rglob("*.py")):
        *packages, name = path.relative_to(ROOT).with_suffix("").parts
        if any(part.startswith("_") for part in packages):
            continue
        package = ".".join(packages)
        if name == "__init__":
            pages.setdefault(package, []).insert(0, package)
        elif not name.startswith("_"):
            pages.setdefault(package, []).append(f"{package}.{name}")
    return dict(sorted(pages.items()))


def format_page(package: str, modules: list[str]) -> str:
    """The Markdown of a package's page of the reference."""
    parts = [f"# `{package}`\n"]
    for module in modules:
        heading = "" if module == package else f"\n## `{module}`\n"
        parts.append(f"{heading}\n::: {module}\n")
    return "".join(parts)


def _source(package: str) -> str:
    """Path of a package's page below docs/."""
    return f"reference/{package}.md"


def on_config(config):
    """Put the reference at the end of the navigation."""
    pages = [{package: _source(package)} for package in list_modules()]
    config.nav.append({"Reference": pages})
    return config


def on_files(files, config):
    """Add the pages of the reference, which lie in no folder."""
    from mkdocs.structure.files import File

    for package, modules in list_modules().items():
        content = format_page(package, modules)
        files.append(File.generated(config, _source(package), content=content))
    return files


def on_page_content(text, page, config, files):
    """Turn the equations of a page into MathML."""
    return EQUATION.sub(lambda m: _convert(m[2], m[1] == "div"), text)


def _convert(tex: str, is_block: bool) -> str:
    """MathML of an equation in LaTeX, escaped as HTML."""
    from latex2mathml.converter import convert

    display = "block" if is_block else "inline"
    return convert(html.unescape(tex).strip(), display=display)
