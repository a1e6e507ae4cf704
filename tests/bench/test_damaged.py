"""Damaged files of every format are read or refused; the full thousand is ``python -m bench.damaged``."""

import pytest
from bench.damaged_bombs import GROUPS
from bench.damaged_files import DAMAGES, WRITERS
from bench.damaged_runs import CELLS, WORKER, Cell, run


@pytest.fixture(scope="module", autouse=True)
def one_process():
    yield
    WORKER.close()


@pytest.mark.parametrize(
    ("file", "damage"), [*zip([*WRITERS, "c.toml"], 6 * ("bits flipped", "large numbers"), strict=True)]
)
def test_a_damaged_file_is_read_or_refused(file, damage):
    found = run(Cell(file, damage), 1000)
    assert found["outcome"] in ("read", "refused"), found


@pytest.mark.parametrize(("group", "bomb"), [("binary", "HDF5, fill value"), ("text", "a pipe")])
def test_a_bomb_is_refused(group, bomb):
    found = run(Cell(group, "bombs"), GROUPS[group].index(bomb))
    assert found["outcome"] == "refused", found


def test_there_are_a_thousand():
    assert sum(cell.runs(15) for cell in CELLS) >= 1000
    assert {cell.damage for cell in CELLS} == {*DAMAGES, "bombs"}
