"""Table of a run, ``fleet.parquet``: a row a calibration, assembled from the parts by block."""

from __future__ import annotations

import itertools
import json
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vibrident.base.errors import InputError
from vibrident.base.fields import NamedTexts
from vibrident.base.files import atomic_write
from vibrident.data.records import FloatArray
from vibrident.lab.fleet import parts
from vibrident.lab.fleet.orders import Orders, memory_limit
from vibrident.lab.fleet.row import FAILED, IDENTIFIED, REFUSED
from vibrident.physics.naming import parameter_names

_BLOCK = 4096  # rows in memory at the same time
_BEFORE = ("calibration", "key", "status", "message", "serial_number", "type", "model", "estimator")
_AFTER = ("adequate", "chi2_reduced", "warnings", "seconds")
UNITS = b"vibrident.units"  # key in the file's metadata: parameter → its units, one in most cases


@dataclass(eq=False)
class Tally:
    """Counts of the table's rows."""

    statuses: Counter[str] = field(default_factory=Counter)  # rows by status
    warnings: Counter[str] = field(default_factory=Counter)  # identified rows by code of warning
    doubtful: int = 0  # identified rows that carry a warning, or whose model is not adequate
    # each set of units that occurs, as JSON, and its number
    sets: dict[str, int] = field(default_factory=dict)
    # number of its set, for each row; shape (rows,)
    units_of: NDArray[np.int32] = field(default_factory=lambda: np.zeros(0, dtype=np.int32))
    # end of each calibration, in seconds since 1970; shape (rows,)
    finished: FloatArray = field(default_factory=lambda: np.zeros(0))

    def add(self, block: Any) -> None:
        """Count a block of the table."""
        values = {
            name: block[name].to_pylist() for name in ("status", "adequate", "warnings", "units")
        }
        self.statuses.update(values["status"])
        rows = zip(values["status"], values["adequate"], values["warnings"], strict=True)
        self.doubtful += sum(
            status == IDENTIFIED and (not adequate or bool(codes))
            for status, adequate, codes in rows
        )
        self.warnings.update(code for codes in values["warnings"] for code in sorted(set(codes)))
        numbers = [self.sets.setdefault(units, len(self.sets)) for units in values["units"]]
        self.units_of = np.append(self.units_of, np.array(numbers, dtype=np.int32))
        self.finished = np.append(
            self.finished, np.asarray(block["finished"].to_numpy(), dtype=float)
        )

    @property
    def units(self) -> list[NamedTexts]:
        """Return each set of units that occurs, parameter → unit."""
        return [json.loads(units) for units in self.sets]

    @property
    def rows(self) -> int:
        """Return the number of calibrations."""
        return self.statuses.total()

    @property
    def doubts(self) -> int:
        """Return the number of rows that a strict run does not let pass."""
        return self.statuses[REFUSED] + self.statuses[FAILED] + self.doubtful

    @property
    def units_of_parameters(self) -> dict[str, list[str]]:
        """Return parameter → the units that it has in one row or another."""
        units_by_name: dict[str, dict[str, None]] = {}
        for units in self.units:
            for name, unit in units.items():
                units_by_name.setdefault(name, {})[unit] = None
        return {name: list(units) for name, units in units_by_name.items()}


def index_of(orders: Orders) -> parts.Index:
    """Index all rows that are on the disk."""
    results = orders.results_folder if orders.results else None
    return parts.index(orders.parts_folder, results, orders.time_limit_s, memory_limit(orders))


def write_table(
    path: Path, names: Iterable[str], keys: NDArray[np.bytes_], orders: Orders
) -> Tally:
    """Write the table, whole or not at all.

    ``path``: of the file; ``names``: of the rows, in order; ``keys``: of the rows, packed (see
    ``parts``), shape (rows,); ``orders``: of the run.

    Raises:
        InputError: the row of a calibration has gone from the parts.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    index = index_of(orders)
    positions = index.positions_of(keys)
    if missing := int(np.sum(positions < 0)):
        raise InputError(
            "Rows were removed during the run.",
            expected="parts that stay where they are",
            found=f"{missing} rows that were written, and are not there",
            where=str(orders.parts_folder),
            remedy=(
                "do not use ⟦fleet.fresh⟧ while another run works in this folder; then give the "
                "same command again"
            ),
        )
    schema = _schema(_parameters(index, positions))
    tally = Tally()
    with (
        atomic_write(path) as partial,
        pq.ParquetWriter(partial, schema, compression="zstd") as writer,
    ):
        named = map(parts.text, names)
        for start in range(0, keys.size, _BLOCK):
            block = _block(orders.parts_folder, index, positions[start : start + _BLOCK], schema)
            tally.add(block)
            names_of_block = pa.array(itertools.islice(named, block.num_rows), pa.string())
            writer.write_table(
                block.set_column(0, "calibration", names_of_block).select(schema.names)
            )
        writer.add_key_value_metadata({UNITS.decode(): json.dumps(tally.units_of_parameters)})
    return tally


def identified_keys(path: Path) -> list[str]:
    """Return the keys of a table's identified rows, each once, in their order."""
    import pyarrow.parquet as pq

    with pq.ParquetFile(path) as file:
        keys = [np.zeros(0, dtype=parts.PACKED)]
        for batch in file.iter_batches(_BLOCK, columns=["key", "status"]):
            pairs = zip(*batch.to_pydict().values(), strict=True)
            keys.append(parts.packed([key for key, status in pairs if status == IDENTIFIED]))
    return parts.digits(np.unique(np.concatenate(keys)))


def _parameters(index: parts.Index, positions: NDArray[np.intp]) -> list[str]:
    """Return all parameters of the rows, the estimated first, in the documentation's order."""
    names = {
        name
        for number in np.unique(index.part[positions]).tolist()
        for name in index.parameters[number]
    }
    ordered = [name for name in parameter_names() if name in names]
    return [*ordered, *sorted(names.difference(ordered))]


def _block(folder: Path, index: parts.Index, positions: NDArray[np.intp], schema: Any) -> Any:
    """Return rows at these places of the index, with all columns."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    pieces = []
    where = []
    part_numbers = index.part[positions]
    for number in np.unique(part_numbers).tolist():
        where.append(np.flatnonzero(part_numbers == number))
        with pq.ParquetFile(folder / index.parts[number]) as file:  # read_table would load far more
            table = file.read()
        pieces.append(_completed(table.take(pa.array(index.row[positions[where[-1]]])), schema))
    order = np.argsort(np.concatenate(where), kind="stable")
    return pa.concat_tables(pieces).take(pa.array(order))


def _schema(parameters: Sequence[str]) -> Any:
    import pyarrow as pa

    texts = [(name, pa.string()) for name in _BEFORE]
    numbers = [(f"{name}{ending}", pa.float64()) for name in parameters for ending in ("", "_u")]
    kinds = (pa.bool_(), pa.float64(), pa.list_(pa.string()), pa.float64())
    return pa.schema([*texts, *numbers, *zip(_AFTER, kinds, strict=True)])


def _completed(table: Any, schema: Any) -> Any:
    """Return a part's columns in the order of the schema, and those that the tally needs.

    Missing columns are null.
    """
    import pyarrow as pa

    full_schema = pa.schema([*schema, ("units", pa.string()), ("finished", pa.float64())])
    present = table.select([name for name in full_schema.names if name in table.column_names])
    return pa.concat_tables(
        [full_schema.empty_table(), present], promote_options="permissive"
    ).cast(full_schema)
