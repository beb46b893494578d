"""Paths of a model's files: takes a document, makes them lead from another folder."""

import os

from .document import MjcfDocument, find_file
from .xml_text import Element, format_path

_SIDES = ("right", "left", "up", "down", "front", "back")
_FILES = {
    **dict.fromkeys(("mesh", "hfield", "skin", "flexcomp"), ("meshdir", ("file",))),
    "texture": ("texturedir", ("file", *(f"file{side}" for side in _SIDES))),
}


def _relative_path(path: str, folder: str) -> str:
    """Path of a file relative to a folder, as MJCF writes it."""
    return format_path(os.path.relpath(path, folder))


def _redirect(element: Element, target: str, folder: str) -> None:
    """Set an element's `file` so that it leads from a folder to a target file."""
    name = element.get_path("file")
    present = os.path.normpath(os.path.join(folder, name))
    if present != os.path.normpath(target):
        element.set({"file": _relative_path(target, folder)})


def relocate_paths(tree: MjcfDocument, folder: str) -> None:
    """Change every path of a document so that it leads from `folder` to the same file.

    Includes come first, then attached models, then assets: whatever has to be inlined
    changes the paths of what follows.
    """
    for element in [e for e in tree.root.walk() if e.included]:
        path, above = element.get_path("file"), element.parent
        target = find_file(path, tree.home, element.home)
        if (
            above
            and above.list_includes()
            and target != find_file(path, folder, element.home)
        ):
            tree.inline(above)  # only the model's own folder led to it
    for element in [e for e in tree.root.walk() if e.tag == "model"]:
        if not (name := element.get_path("file")):
            continue  # MuJoCo will say so
        target = find_file(name, element.home, tree.home)
        # MuJoCo seeks what an included file attaches from the model's own folder
        if not element.list_includes() or folder != tree.home:
            _redirect(tree.inline(element), target, folder)
    _relocate_assets(tree, folder)
    for element in [e for e in tree.root.walk() if e.list_includes() == [e]]:
        target = find_file(element.get_path("file"), tree.home, element.home)
        _redirect(element, target, folder)


def _relocate_assets(tree: MjcfDocument, folder: str) -> None:
    """Change the folders of meshes and textures so that they lead from `folder`."""
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
            path = _relative_path(os.path.join(tree.home, value), folder)
            tree.inline(element).set({attribute: path})
    for kind in used:  # again: inlining a compiler may have inlined assets, too
        _redirect_assets(tree, kind, moved[owner] if (owner := owners[kind]) else "")
    if bare := [kind for kind in used if not owners[kind]]:
        attribute = bare[0] if len(bare) == 1 else "assetdir"
        tree.get_section("compiler", first=False).set(
            {attribute: _relative_path(tree.home, folder)}
        )


def _find_owner(tree: MjcfDocument, kind: str) -> tuple[Element, str] | None:
    """The last <compiler> that sets a folder, and its attribute; None: none does."""
    for element in tree.list_sections("compiler")[::-1]:
        for attribute in (kind, "assetdir"):
            if element.get(attribute) is not None:
                return element, attribute
    return None


def _owner_value(owner: tuple[Element, str] | None) -> str:
    """Value of a compiler's attribute, a path; empty without one."""
    return owner[0].get_path(owner[1]) if owner else ""


def _redirect_assets(tree: MjcfDocument, kind: str, value: str) -> bool:
    """Set the files of inlined assets so that an asset folder leads to them.

    MuJoCo looks for the file of an included element in the asset folder first, then
    beside the file that includes it.

    Returns:
        Whether the folder leads to any file.
    """
    base, is_used = os.path.join(tree.home, value), False
    strips = any(c.get("strippath") == "true" for c in tree.list_sections("compiler"))
    for element in tree.root.walk():
        folder_kind, attributes = _FILES.get(element.tag, ("", ()))
        for attribute in attributes if folder_kind == kind else ():
            name = element.get_path(attribute)
            name = os.path.basename(name) if strips else name
            if not name or os.path.isabs(name):
                continue
            path = find_file(name, base, element.home)
            if path != os.path.join(base, name):
                if element.list_includes():
                    continue  # it stays beside the file that includes it
                element.set({attribute: _relative_path(path, base)})
            is_used = True
    return is_used
