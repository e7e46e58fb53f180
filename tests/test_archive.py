"""Saved results: what was written comes back, or a damaged file is refused; nothing is unpickled."""

import errno
import io
import os
import pickle

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from lissome import _archive
from lissome.errors import DataError
from lissome.structure import VectorState, load_state, save_state

META = {"kind": "branch", "count": 2}
ARRAYS = {"x": np.arange(4.0), "name": np.array("é"), "flag": np.array([True])}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("archive")
    _archive.write(folder / "branch.npz", META, ARRAYS)
    save_state(folder / "state.npz", VectorState([1.0, 2.0]))
    return folder


def test_what_was_written_comes_back(folder):
    meta, arrays = _archive.read(folder / "branch.npz", "branch")
    assert meta == META
    assert arrays.keys() == ARRAYS.keys()
    assert all((arrays[name] == ARRAYS[name]).all() for name in ARRAYS)
    with pytest.raises(DataError, match="holds a branch; a history was asked for"):
        _archive.read(folder / "branch.npz", "history")


def one_array():
    stream = io.BytesIO()
    np.save(stream, np.arange(2.0))
    return stream.getvalue()


@settings(max_examples=300)
@given(
    st.sampled_from(["branch", "state"]), st.integers(0, 2**16), st.integers(0, 255), st.booleans()
)
def test_a_damaged_file_is_refused_or_the_damage_does_not_matter(folder, kind, place, bits, cut):
    raw = bytearray((folder / f"{kind}.npz").read_bytes())
    place %= len(raw)
    raw[place] ^= bits
    path = folder / "damaged.npz"
    path.write_bytes(raw[:place] if cut else raw)
    try:
        if kind == "state":
            assert load_state(path, VectorState).x.tolist() == [1.0, 2.0]
        else:
            meta, arrays = _archive.read(path, "branch")
            assert meta == META
            assert all((arrays[name] == ARRAYS[name]).all() for name in ARRAYS)
    except DataError:
        pass


@given(st.binary(max_size=100))
@example(b"\x93NUMPY\x01\x00")
@example(one_array())
@example(b"PK\x05\x06" + bytes(18))
def test_any_bytes_are_refused(folder, raw):
    path = folder / "any.npz"
    path.write_bytes(raw)
    with pytest.raises(DataError, match=r"any\.npz"):
        _archive.read(path, "branch")
    with pytest.raises(DataError, match=r"any\.npz"):
        load_state(path, VectorState)


class Bomb:
    def __init__(self, mark):
        self.mark = mark

    def __reduce__(self):
        return open, (self.mark, "w")


def test_pickles_are_not_loaded(folder, tmp_path):
    mark = str(tmp_path / "mark")
    stream = io.BytesIO()
    np.savez(stream, x=np.array([Bomb(mark)], dtype=object), __class__=np.array("VectorState"))
    for raw in (stream.getvalue(), pickle.dumps(Bomb(mark))):
        path = tmp_path / "evil.npz"
        path.write_bytes(raw)
        with pytest.raises(DataError):
            _archive.read(path, "branch")
        with pytest.raises(DataError):
            load_state(path, VectorState)
        assert not os.path.exists(mark)


def test_a_full_disk_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch):
    path = tmp_path / "branch.npz"
    _archive.write(path, META, ARRAYS)

    def full(file, **arrays):
        file.write(b"half")
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(np, "savez", full)
    with pytest.raises(OSError, match="No space left"):
        _archive.write(path, META | {"count": 3}, ARRAYS)
    assert [entry.name for entry in tmp_path.iterdir()] == ["branch.npz"]
    assert _archive.read(path, "branch")[0] == META
