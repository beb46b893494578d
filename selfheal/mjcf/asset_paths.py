"""Where a model's files are: makes what it says of them lead from another folder."""

import os
from pathlib import Path

from .document import MjcfDocument, find_file
from .xml_text import Element

_FILES = {
    **dict.fromkeys(("mesh", "hfield", "skin", "flexcomp"), ("meshdir", ("file",))),
    "texture": (
        "texturedir",
        ("file", *(f"file{s}" for s in "right left up down front back".split())),
    ),
}


def _relative_path(path: str, folder: str) -> str:
    """A relative path as a model writes it."""
    return Path(os.path.relpath(path, folder)).as_posix()


def _redirect(element: Element, target: str, folder: str) -> None:
    """Make an element's `file` lead from a folder to where it shall."""
    name = element.get("file") or ""
    leads = os.path.normpath(os.path.join(folder, name))
    if leads != os.path.normpath(target):
        element.set({"file": _relative_path(target, folder)})


def relocate_paths(tree: MjcfDocument, folder: str) -> None:
    """Make every path lead from `folder` to the file that it led to."""
    for element in [e for e in tree.root.walk() if e.included]:
        path, above = element.get("file") or "", element.parent
        target = find_file(path, tree.home, element.home)
        if (
            above
            and above.list_includes()
            and target != find_file(path, folder, element.home)
        ):
            tree.inline(above)  # only the model's own folder led to it
    for element in [e for e in tree.root.walk() if e.tag == "model"]:
        if not (name := element.get("file")):
            continue  # MuJoCo will say so
        target = find_file(name, element.home, tree.home)
        if not element.list_includes() or target != find_file(
            name, element.home, folder
        ):
            _redirect(tree.inline(element), target, folder)
    _relocate_assets(tree, folder)
    for element in [e for e in tree.root.walk() if e.list_includes() == [e]]:
        target = find_file(element.get("file") or "", tree.home, element.home)
        _redirect(element, target, folder)


def _relocate_assets(tree: MjcfDocument, folder: str) -> None:
    """Move the folders of meshes and textures, as seen from where the text will lie."""
    owners = {kind: _find_owner(tree, kind) for kind in ("meshdir", "texturedir")}
    used = [
        k
        for k, owner in owners.items()
        if _redirect_assets(tree, k, _owner_value(owner))
    ]
    if folder == tree.home:
        return
    moved = {owner: _owner_value(owner) for k in used if (owner := owners[k])}
    for (element, attribute), value in moved.items():
        if not os.path.isabs(value):
            way = _relative_path(os.path.join(tree.home, value), folder)
            tree.inline(element).set({attribute: way})
    for kind in used:  # again: owning may have brought more into the main file
        _redirect_assets(tree, kind, moved[owner] if (owner := owners[kind]) else "")
    if bare := [kind for kind in used if not owners[kind]]:
        attribute = bare[0] if len(bare) == 1 else "assetdir"
        tree.get_section("compiler").set({attribute: _relative_path(tree.home, folder)})


def _find_owner(tree: MjcfDocument, kind: str) -> tuple[Element, str] | None:
    """The compiler and the attribute that have the last word on a folder."""
    for element in tree.list_sections("compiler")[::-1]:
        for attribute in (kind, "assetdir"):
            if element.get(attribute) is not None:
                return element, attribute
    return None


def _owner_value(owner: tuple[Element, str] | None) -> str:
    return (owner[0].get(owner[1]) or "") if owner else ""


def _redirect_assets(tree: MjcfDocument, kind: str, value: str) -> bool:
    """Whether a folder leads to any file; an inlined element is made to use it.

    MuJoCo looks for the file of an included element in that folder first, then beside
    the file that includes it.
    """
    base, leads = os.path.join(tree.home, value), False
    strips = any(c.get("strippath") == "true" for c in tree.list_sections("compiler"))
    for element in tree.root.walk():
        its_kind, attributes = _FILES.get(element.tag, ("", ()))
        for attribute in attributes if its_kind == kind else ():
            name = element.get(attribute) or ""
            name = os.path.basename(name) if strips else name
            if not name or os.path.isabs(name):
                continue
            path = find_file(name, base, element.home)
            if path != os.path.join(base, name):
                if element.list_includes():
                    continue  # it stays beside the file that includes it
                element.set({attribute: _relative_path(path, base)})
            leads = True
    return leads
