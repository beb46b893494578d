"""A walk as a moving picture: rendered where there is OpenGL, else drawn."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .motion import (
    FRAME,
    Lane,
    count_common_rows,
    draw_animation,
    embed_animation,
    encode_frames,
)
from .page import Html
from .picture import INK, PAPER
from .render import SQUARE, render_lanes

if TYPE_CHECKING:
    from PIL.Image import Image
    from PIL.ImageFont import FreeTypeFont

_QUALITY = 60  # of a WebP, of 100; chosen
_LETTERS, _BAND = 15, 26  # [px] of titles, and what they stand on; chosen


def make_film(
    lanes: Sequence[Lane], heading: float, caption: str, *, sample: float
) -> Html:
    """Walks below each other, every fifth of a second at double speed.

    Args:
        heading: direction that is shown to the right [rad].
        caption: below; also what a screen reader says.
        sample: seconds between the rows of a lane.
    """
    from PIL import features

    rows = range(0, count_common_rows(lanes), max(1, round(FRAME / sample)))
    shown = render_lanes(lanes, heading, rows) if features.check("webp") else None
    if shown is None:
        return draw_animation(lanes, heading, caption, sample=sample)
    squares = f" Rendered by MuJoCo; squares of {SQUARE} m, the dark line is the start."
    frames = join_strips([lane.title for lane in lanes], shown, beside=False)
    return embed_animation(
        encode_webp(frames, duration=FRAME / 2), "webp", caption + squares
    )


def join_strips(
    titles: Sequence[str], shown: np.ndarray, *, beside: bool
) -> list["Image"]:
    """Pictures of several strips, each below its title.

    Args:
        shown: (strips, frames, height, width, 3) uint8.
        beside: whether strips are beside each other, instead of below.
    """
    from PIL import Image, ImageDraw

    font, frames = _load_font(), []
    count, _, height, width = shown.shape[:4]
    columns, rows = (count, 1) if beside else (1, count)
    for strips in shown.swapaxes(0, 1):
        image = Image.new("RGB", (columns * width, rows * (_BAND + height)), PAPER)
        draw = ImageDraw.Draw(image)
        for k, (title, strip) in enumerate(zip(titles, strips, strict=True)):
            left, top = (k * width, 0) if beside else (0, k * (_BAND + height))
            draw.text((left + 4, top + 4), title, fill=INK, font=font)
            image.paste(Image.fromarray(strip), (left, top + _BAND))
        frames.append(image)
    return frames


def encode_webp(frames: Sequence["Image"], *, duration: float = 1.0) -> bytes:
    """One picture, or several as a moving one, each shown for a duration [s]."""
    return encode_frames(frames, "WEBP", duration=duration, quality=_QUALITY, method=2)


def _load_font() -> "FreeTypeFont":
    """The letters that matplotlib carries with it."""
    import matplotlib
    from PIL import ImageFont

    path = Path(matplotlib.get_data_path(), "fonts", "ttf", "DejaVuSans.ttf")
    return ImageFont.truetype(str(path), _LETTERS)
