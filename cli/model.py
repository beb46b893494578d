"""`selfheal model`: takes a robot's URDF or MJCF, gives one that can be diagnosed."""

from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from selfheal.errors import InputError
from selfheal.files import check_file

from ._options import AS_JSON, FORCE, make_epilog, out_file
from ._print import print_document, print_line
from ._runs import refuse_existing

if TYPE_CHECKING:
    from selfheal.preparation.drives import Gains

app = typer.Typer(help="Prepare models.", no_args_is_help=True, rich_markup_mode=None)
_EXAMPLE = "selfheal model prepare arm.urdf --kp 60 --kp wrist=10 --out arm.xml"

_MODEL = typer.Argument(metavar="ROBOT", help="The robot's URDF or MJCF.")
_KP = typer.Option(
    metavar="[JOINT=]VALUE",
    help="Stiffness of position servos [N m/rad; N/m], which also take the "
    "places of torque motors; --kp 60 --kp wrist=10.",
)
_KV = typer.Option(
    metavar="[JOINT=]VALUE",
    help="Their damping [N m s/rad; N s/m]; without: the critical one.",
)
_MOTORS = typer.Option("--motors", help="Torque motors: commands are in N m or N.")
_WELD_BASE = typer.Option("--weld-base", help="Fix a base that has a free joint.")
_NO_CONTACTS = typer.Option(
    "--no-contacts", help="Leave out geoms: the robot touches nothing."
)
_PASSIVE = typer.Option(metavar="JOINT", help="A joint that gets no drive; once each.")


@app.callback()
def _model() -> None:
    """Prepare models."""


@app.command(epilog=make_epilog(_EXAMPLE, "prepare-a-model.md"))
def prepare(
    model: Annotated[Path, _MODEL],
    out: Annotated[Path, out_file("MODEL.xml")] = Path("prepared.xml"),
    kp: Annotated[list[str] | None, _KP] = None,
    kv: Annotated[list[str] | None, _KV] = None,
    motors: Annotated[bool, _MOTORS] = False,
    weld_base: Annotated[bool, _WELD_BASE] = False,
    no_contacts: Annotated[bool, _NO_CONTACTS] = False,
    passive: Annotated[list[str] | None, _PASSIVE] = None,
    force: Annotated[bool, FORCE] = False,
    as_json: Annotated[bool, AS_JSON] = False,
) -> None:
    """Write the MJCF of a robot with a drive at every joint that lacks one."""
    from selfheal.preparation.drives import Gains
    from selfheal.preparation.prepare import prepare_model, write_model

    stiffness, damping = _read_gains("--kp", kp), _read_gains("--kv", kv)
    gains = Gains(stiffness, damping, tuple(passive or ()), motors)
    _check_drives(gains)
    check_file(model)
    refuse_existing(out, [model], force=force)
    done = prepare_model(
        model, out.parent, gains, weld_base=weld_base, without_contacts=no_contacts
    )
    out.parent.mkdir(parents=True, exist_ok=True)
    write_model(done, out)
    if as_json:
        print_document("prepare", model=str(model), out=str(out), steps=[*done.steps])
        return
    for step in done.steps:
        print_line(step)
    print_line(
        f"wrote {out}; then: selfheal recording import LOG --model {out} --guess"
    )


def _check_drives(gains: "Gains") -> None:
    """Refuse what says no drive."""
    stiff, damped = bool(gains.kp), bool(gains.kv)
    if (gains.motors and stiff) or (damped and not stiff):
        raise InputError(
            "--motors is for commands of torque, --kp for goal positions, --kv goes "
            "with it; would fit: one of --kp VALUE, --kp VALUE --kv VALUE, --motors"
        )


def _read_gains(option: str, entries: list[str] | None) -> dict[str, float]:
    """Gains by joint of what an option was given; "" for all others."""
    found: dict[str, float] = {}
    for entry in entries or ():
        joint, _, value = entry.rpartition("=")
        try:
            number = float(value)
        except ValueError:
            number = -1.0
        if not (isfinite(number) and number >= 0) or joint in found:
            raise InputError(
                f"{option} {entry}: would fit: a number of 0 or more for all joints, "
                "or JOINT=NUMBER, once each"
            )
        found[joint] = number
    return found
