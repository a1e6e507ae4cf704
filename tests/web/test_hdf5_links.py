"""Uploaded HDF5 files reach no other file."""

from __future__ import annotations

import h5py
import numpy as np
import pytest

from vibrident.errors import InputError
from vibrident.io.readers import open_columns
from vibrident.web.hdf5_links import refuse_other_files

SECRET = np.arange(7.0)


def external_link(file, other):
    file["group/link"] = h5py.ExternalLink(str(other), "/secret")


def external_storage(file, other):
    file.create_dataset("group/stored", shape=(7,), dtype="f8", external=[(str(other), 0, h5py.h5f.UNLIMITED)])


def virtual(file, other):
    layout = h5py.VirtualLayout(shape=(7,), dtype="f8")
    layout[:] = h5py.VirtualSource(str(other), "secret", shape=(7,))
    file.create_virtual_dataset("group/virtual", layout)


@pytest.mark.parametrize("ending", [".h5", ".mat", ".csv"])
@pytest.mark.parametrize("refer", [external_link, external_storage, virtual])
def test_a_file_that_refers_to_another_is_refused(tmp_path, refer, ending):
    path, other = tmp_path / f"uploaded{ending}", tmp_path / "other"
    userblock = 512 if ending == ".mat" else 0  # MATLAB writes its own header before
    with h5py.File(path, "w", userblock_size=userblock) as file:
        file["plain"] = SECRET
        refer(file, other)
    with pytest.raises(InputError, match="stand alone") as caught:
        refuse_other_files(path)
    assert str(other) in caught.value.found
    assert not other.exists()


def test_numbers_of_another_file_would_be_read_without_the_check(tmp_path):
    """The danger is there: HDF5 hands out any file's bytes as numbers."""
    other = tmp_path / "other"
    other.write_bytes(SECRET.tobytes())
    with h5py.File(tmp_path / "uploaded.h5", "w") as file:
        external_storage(file, other)
    (read,) = open_columns(tmp_path / "uploaded.h5").load([0])
    assert np.array_equal(read, SECRET)


def test_a_file_that_stands_alone_passes(tmp_path):
    path = tmp_path / "alone.h5"
    with h5py.File(path, "w") as file:
        file["group/data"] = SECRET
        file["soft"] = h5py.SoftLink("/group/data")
        file["nowhere"] = h5py.SoftLink("/not/there")
        file["group/itself"] = file["group"]  # a circle of hard links
        layout = h5py.VirtualLayout(shape=(7,), dtype="f8")
        layout[:] = h5py.VirtualSource(".", "group/data", shape=(7,))
        file.create_virtual_dataset("virtual", layout)
    refuse_other_files(path)


def test_what_is_not_hdf5_passes_and_what_is_damaged_does_not(tmp_path):
    path = tmp_path / "a.h5"
    path.write_text("time,response\n")
    refuse_other_files(path)
    with h5py.File(path, "w") as file:
        file["data"] = SECRET
    path.write_bytes(path.read_bytes()[:600])
    with pytest.raises(InputError, match="cannot be read"):
        refuse_other_files(path)
