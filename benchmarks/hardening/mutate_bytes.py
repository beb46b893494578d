"""Broken bytes: a file's content and a seed in; the content with damage out."""

import numpy as np

_HEAD = 8192  # bytes at the start, where HDF5 keeps most of what describes the rest
_BLOCK = 1024  # most bytes of a block


def mutate_bytes(content: bytes, seed: int) -> bytes:
    """Damage a content as disks and transfers do, at one place or a few."""
    rng = np.random.default_rng(seed)
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        if content:
            content = _change_block(content, rng)
    return content


def _draw_block(content: bytes, rng: np.random.Generator) -> slice:
    """A block of the content, half of the time one near its start."""
    reach = min(len(content), _HEAD) if rng.random() < 0.5 else len(content)
    start = int(rng.integers(reach))
    return slice(start, min(start + int(rng.integers(1, _BLOCK)), len(content)))


def _change_block(content: bytes, rng: np.random.Generator) -> bytes:
    """The content with a block overwritten, lost, repeated or cut, or bits flipped."""
    block, kind = _draw_block(content, rng), rng.integers(7)
    if kind == 0:
        damaged = bytearray(content)
        for _ in range(rng.integers(1, 9)):
            damaged[_draw_block(content, rng).start] ^= 1 << int(rng.integers(8))
        return bytes(damaged)
    if kind == 1:
        return content[: block.start]
    old = content[block]
    other = content[_draw_block(content, rng)][: len(old)]
    new = (rng.bytes(len(old)), bytes(len(old)), b"", 2 * old, other)[kind - 2]
    return content[: block.start] + new + content[block.stop :]
