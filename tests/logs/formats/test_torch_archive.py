"""Archives as torch.save writes them, made without torch."""

import os
import pickle

import numpy as np
import pytest

from selfheal.errors import InputError
from selfheal.logs.open_log import open_log
from tests.support.logs.reading import read_all, read_one
from tests.support.logs.torch_files import Tensor, save_archive

TIME = np.arange(20, dtype="f4") / 100
ANGLES = np.random.default_rng(0).normal(size=(20, 3)).astype("f4")


@pytest.fixture
def save(tmp_path):
    """Writes an archive, as torch.save does."""

    def save(document, raw=None, name="log.pt"):
        save_archive(tmp_path / name, document, raw)
        return tmp_path / name

    return save


def test_a_tensor_of_times_is_the_time(save):
    log = open_log(save({"time": Tensor(TIME), "dof_pos": Tensor(ANGLES), "gain": 20}))
    (stream,) = log.streams
    assert stream.time == "time" and stream.columns["time"] == "s"
    assert list(read_all(log)[""]) == ["time", *(f"dof_pos[{k}]" for k in range(3))]


def test_views_of_a_storage_are_read_as_torch_sees_them(save):
    turned = Tensor(ANGLES, strides=(1, 20), shape=(20, 3))
    part = Tensor(np.arange(40), strides=(2,), shape=(20,), offset=1)
    found = read_one(save([turned, {"part": part}, (Tensor(TIME > 0.1),)]))
    flat = ANGLES.ravel()
    np.testing.assert_array_equal(found["[0][1]"], flat[20:40])
    np.testing.assert_array_equal(found["[1].part"], np.arange(1, 40, 2))
    np.testing.assert_array_equal(found["[2][0]"], TIME > 0.1)


class _Program:
    def __reduce__(self):
        return os.system, ("touch /tmp/selfheal-was-here",)


@pytest.mark.parametrize(
    "raw",
    [
        pickle.dumps(_Program(), protocol=2),
        pickle.dumps(_Program(), protocol=4),
        b"cbuiltins\neval\n(V1\ntR.",
        b"\x80\x02ccollections\nOrderedDict\n)R}U\x01a1b.",
        b"\x80\x02r\xff\xff\xff\xff}.",
        b"\x80\x02ctorch\nFloatStorage\n(tR.",
        b"\x80\x05\x96\xff\xff\xff\xff\xff\x00\x00\x00.",  # a bytearray of terabytes
        b"\x80\x02" + b"(" * 100_000 + b".",
        b"",
    ],
)
def test_no_program_is_run_and_nothing_else_is_read(save, raw):
    with pytest.raises(InputError):
        read_one(save({}, raw=raw or b"."))
    assert not os.path.exists("/tmp/selfheal-was-here")


@pytest.mark.parametrize(
    "tensor",
    [
        Tensor(TIME, shape=(2000,), strides=(1,)),
        Tensor(TIME, shape=(10**9,), strides=(0,)),
        Tensor(TIME, shape=(10, 2), strides=(4, 1)),
        Tensor(TIME, shape=(5,), strides=(-1,), offset=4),
        Tensor(TIME, shape=(10,), strides=(1,), offset=-3),
        Tensor(TIME, shape=(10,), strides=(1,), offset=15),
    ],
)
def test_a_tensor_outside_its_storage_is_refused(save, tensor):
    with pytest.raises(InputError, match="tensor"):
        read_one(save({"q": tensor}))


def test_a_container_that_holds_itself_is_read(save):
    document = {"q": Tensor(TIME)}
    document["again"] = document
    assert list(read_one(save(document))) == ["q"]


def test_other_files_of_that_suffix_are_refused(tmp_path):
    path = tmp_path / "old.pt"
    path.write_bytes(pickle.dumps({"a": 1}, protocol=2))
    with pytest.raises(InputError, match="PyTorch"):
        open_log(path)
