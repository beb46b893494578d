"""Actuators in the text of a model: takes places, gives edits of the MJCF."""

from ...mjcf.edit import Rename, format_number


def name_or_id(model, place):
    """What the text's edits call an actuator."""
    return model.actuator(place["actuator"]).name or place["actuator"]


def rename_to_general(model, place, **attributes) -> list[Rename]:
    """The actuator as a <general> one of the same law, with more attributes.

    Args:
        model: compiled, as its text states it.
        place: of an actuator with one control and an affine force.
        attributes: of the <general>, beside those of its law.
    """
    a = place["actuator"]
    law = {
        "gainprm": format_number(model.actuator_gainprm[a, :3]),
        "biasprm": format_number(model.actuator_biasprm[a, :3]),
        "biastype": "affine" if model.actuator_biastype[a] == 1 else "none",
        "gaintype": "affine" if model.actuator_gaintype[a] == 1 else "fixed",
        **{
            k: v if isinstance(v, str) else format_number(v)
            for k, v in attributes.items()
        },
    }
    (control,) = place["controls"]
    if model.actuator_ctrllimited[control]:  # a <general> inherits no range
        law["ctrlrange"] = format_number(model.actuator_ctrlrange[control])
    own = ("kp", "kv", "gain", "dampratio", "timeconst", "inheritrange")
    gone = dict.fromkeys(own)
    return [Rename("actuator", name_or_id(model, place), "general", {**gone, **law})]
