"""Archives as torch.save writes them, made without torch."""

import io
import pickle
import sys
import types
import zipfile
from collections import OrderedDict
from pathlib import Path
from unittest.mock import patch

import numpy as np

_NAMES = {"f4": "Float", "f8": "Double", "i8": "Long", "?": "Bool"}


class Tensor:
    """Stands for a tensor; pickled as torch does it."""

    def __init__(self, values, strides=None, shape=None, offset=0):
        self.values = np.asarray(values)
        self.shape = shape or self.values.shape
        self.strides = strides or tuple(
            s // self.values.itemsize for s in self.values.strides
        )
        self.offset = offset

    def __reduce__(self):
        rebuild = sys.modules["torch._utils"]._rebuild_tensor_v2
        storage = _Storage(self.values)
        return rebuild, (
            *(storage, self.offset, self.shape, self.strides),
            *(False, OrderedDict()),
        )


class _Storage:
    def __init__(self, values):
        self.values = values


class _Pickler(pickle.Pickler):
    def __init__(self, file, data):
        super().__init__(file, protocol=2)
        self.data = data

    def persistent_id(self, value):
        if not isinstance(value, _Storage):
            return None
        key = str(len(self.data))
        self.data[key] = np.ascontiguousarray(value.values).tobytes()
        kind = _NAMES[value.values.dtype.str.lstrip("<|").replace("b1", "?")]
        storage = getattr(sys.modules["torch"], f"{kind}Storage")
        return "storage", storage, key, "cpu", value.values.size


def _make_modules() -> dict[str, types.ModuleType]:
    """Modules that have the names which a pickle of torch has."""
    torch, utils = types.ModuleType("torch"), types.ModuleType("torch._utils")
    for name in _NAMES.values():
        kind = type(f"{name}Storage", (), {"__module__": "torch"})
        setattr(torch, kind.__name__, kind)

    def _rebuild_tensor_v2():
        raise AssertionError

    _rebuild_tensor_v2.__module__ = "torch._utils"
    _rebuild_tensor_v2.__qualname__ = "_rebuild_tensor_v2"
    utils.__dict__["_rebuild_tensor_v2"] = _rebuild_tensor_v2
    return {"torch": torch, "torch._utils": utils}


def save_archive(path: Path, document: object, raw: bytes | None = None) -> None:
    """Write an archive, as torch.save does.

    Args:
        document: containers of `Tensor`s.
        raw: a pickle in the place of the document's.
    """
    buffer, data = io.BytesIO(), dict[str, bytes]()
    with patch.dict(sys.modules, _make_modules()):
        _Pickler(buffer, data).dump(document)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("log/data.pkl", raw or buffer.getvalue())
        archive.writestr("log/byteorder", "little")
        for key, content in data.items():
            archive.writestr(f"log/data/{key}", content)
        archive.writestr("log/version", "3\n")
