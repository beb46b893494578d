"""Broken bytes: a file's content and a seed in; the content with damage out."""

import numpy as np

_HEAD = 8192  # bytes at the start, where HDF5 keeps most of what describes the rest
_BLOCK = 1024  # most bytes of a block


def mutate_bytes(content: bytes, seed: int) -> bytes:
    """Damage a content as disks and transfers do, at one place or a few."""
    rng = np.random.default_rng(seed)
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        if content:
            content = _CHANGES[rng.integers(len(_CHANGES))](content, rng)
    return content


def _draw_block(content: bytes, rng: np.random.Generator) -> slice:
    """A block of the content, half of the time one near its start."""
    reach = min(len(content), _HEAD) if rng.random() < 0.5 else len(content)
    start = int(rng.integers(reach))
    return slice(start, min(start + int(rng.integers(1, _BLOCK)), len(content)))


def _replace_block(content: bytes, block: slice, new: bytes) -> bytes:
    return content[: block.start] + new + content[block.stop :]


def _flip_bits(content: bytes, rng: np.random.Generator) -> bytes:
    damaged = bytearray(content)
    for _ in range(rng.integers(1, 9)):
        damaged[_draw_block(content, rng).start] ^= 1 << int(rng.integers(8))
    return bytes(damaged)


def _overwrite(content: bytes, rng: np.random.Generator) -> bytes:
    block = _draw_block(content, rng)
    return _replace_block(content, block, rng.bytes(block.stop - block.start))


def _zero(content: bytes, rng: np.random.Generator) -> bytes:
    block = _draw_block(content, rng)
    return _replace_block(content, block, bytes(block.stop - block.start))


def _cut_end(content: bytes, rng: np.random.Generator) -> bytes:
    return content[: _draw_block(content, rng).start]


def _cut_block(content: bytes, rng: np.random.Generator) -> bytes:
    return _replace_block(content, _draw_block(content, rng), b"")


def _repeat_block(content: bytes, rng: np.random.Generator) -> bytes:
    block = _draw_block(content, rng)
    return _replace_block(content, block, 2 * content[block])


def _swap_blocks(content: bytes, rng: np.random.Generator) -> bytes:
    one, two = _draw_block(content, rng), _draw_block(content, rng)
    size = min(one.stop - one.start, two.stop - two.start)
    damaged = bytearray(content)
    damaged[one.start : one.start + size] = content[two.start : two.start + size]
    damaged[two.start : two.start + size] = content[one.start : one.start + size]
    return bytes(damaged)


_CHANGES = (_flip_bits, _overwrite, _zero, _cut_end, _cut_block, _repeat_block,
            _swap_blocks)  # fmt: skip
