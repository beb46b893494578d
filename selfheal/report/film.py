"""A walk as a moving picture: rendered where there is OpenGL, else drawn."""

import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .motion import FRAME, Lane, count_common_rows, draw_animation, embed_animation
from .page import Html
from .picture import INK, PAPER
from .render import SQUARE, render_lanes

if TYPE_CHECKING:
    from PIL.ImageFont import FreeTypeFont

_QUALITY = 60  # of a WebP, of 100; chosen
_LETTERS, _BAND = 15, 26  # [px] of titles, and what they stand on; chosen


def make_film(
    lanes: Sequence[Lane], heading: float, caption: str, *, sample: float
) -> Html:
    """Walks below each other, every fifth of a second at double speed.

    Args:
        lanes: what to show.
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
    return embed_animation(_encode_webp(lanes, shown), "webp", caption + squares)


def _encode_webp(lanes: Sequence[Lane], shown: np.ndarray) -> bytes:
    """Titled strips (lanes, frames, height, width, 3) as one moving picture."""
    from PIL import Image, ImageDraw

    font, frames = _load_font(), []
    count, _, height, width = shown.shape[:4]
    for strips in shown.swapaxes(0, 1):
        image = Image.new("RGB", (width, count * (_BAND + height)), PAPER)
        draw = ImageDraw.Draw(image)
        for k, (lane, strip) in enumerate(zip(lanes, strips, strict=True)):
            top = k * (_BAND + height)
            draw.text((4, top + 4), lane.title, fill=INK, font=font)
            image.paste(Image.fromarray(strip), (0, top + _BAND))
        frames.append(image)
    buffer = io.BytesIO()
    first, *others = frames
    first.save(buffer, "WEBP", save_all=True, append_images=others, loop=0,
               duration=round(500 * FRAME), quality=_QUALITY, method=2)  # fmt: skip
    return buffer.getvalue()


def _load_font() -> "FreeTypeFont":
    """The letters that matplotlib carries with it."""
    import matplotlib
    from PIL import ImageFont

    path = Path(matplotlib.get_data_path(), "fonts", "ttf", "DejaVuSans.ttf")
    return ImageFont.truetype(str(path), _LETTERS)
