"""Bags for pandas and spreadsheets: CSV or Parquet, one file per table."""

from __future__ import annotations

import csv
from itertools import islice
from typing import TYPE_CHECKING, Literal

from cmpsp_ros.bags.errors import BagError
from cmpsp_ros.bags.export.tables import Column, Row, Table, tables
from cmpsp_ros.bags.reader import Bag

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

Format = Literal['csv', 'parquet']

_BATCH = 10_000
"""Rows held at a time."""


def export(bag_path: Path, folder: Path, form: Format = 'csv') -> dict[Path, int]:
    """Write the tables of a bag.

    A CSV file names its columns with their units, as in `x [m]`, and writes floats so that they
    read back bit for bit. A Parquet file keeps the unit of a column in its field's metadata, under
    `unit`. What is missing in a row is empty.

    Args:
        bag_path: The bag.
        folder: New folder for the files; missing parents are made.
        form: Format of the files.

    Returns:
        Number of rows of each file.

    Raises:
        BagError: Not a bag, nothing in it makes a table, the folder exists, pyarrow is not
            installed, or the disk refuses.
    """
    write = _write_csv if form == 'csv' else _parquet_writer()
    with Bag(bag_path) as bag:
        chosen = tables(bag)
        try:
            folder.mkdir(parents=True)
            return {
                path: write(table, path)
                for table in chosen
                for path in [folder / f'{table.name}.{form}']
            }
        except FileExistsError as error:
            msg = f'{folder}: exists already, tables need a folder that does not exist'
            raise BagError(msg) from error
        except OSError as error:
            raise BagError(f'{folder}: cannot write the tables: {error}') from error


def _write_csv(table: Table, path: Path) -> int:
    with path.open('x', newline='', encoding='utf-8') as file:
        writer = csv.writer(file)
        writer.writerow([_title(each) for each in table.columns])
        count = 0
        for batch in _batches(table.rows()):
            writer.writerows(batch)
            count += len(batch)
    return count


def _parquet_writer() -> Callable[[Table, Path], int]:
    try:
        import pyarrow as pa  # type: ignore[import-untyped]  # noqa: PLC0415 (not all need it)
        from pyarrow import parquet  # noqa: PLC0415
    except ImportError as error:
        raise BagError('Parquet needs pyarrow: pip install pyarrow') from error

    types = {'int': pa.int64(), 'float': pa.float64(), 'bool': pa.bool_(), 'text': pa.string()}

    def write(table: Table, path: Path) -> int:
        schema = pa.schema(
            pa.field(each.name, types[each.kind], metadata={'unit': each.unit} if each.unit else {})
            for each in table.columns
        )
        count = 0
        with parquet.ParquetWriter(path, schema) as writer:
            for batch in _batches(table.rows()):
                columns = [
                    pa.array(cells, each.type)
                    for cells, each in zip(zip(*batch, strict=True), schema, strict=True)
                ]
                writer.write_table(pa.Table.from_arrays(columns, schema=schema))
                count += len(batch)
        return count

    return write


def _batches(rows: Iterator[Row]) -> Iterator[list[Row]]:
    while batch := list(islice(rows, _BATCH)):
        yield batch


def _title(column: Column) -> str:
    return f'{column.name} [{column.unit}]' if column.unit else column.name
