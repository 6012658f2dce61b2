"""Tables of cells as results keep them, and as they are published: with their columns, without images."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import pandas

from glossbench.errors import InputError
from glossbench.findings.columns import Column, columns_from_json
from glossbench.run.records import Records
from glossbench.run.results import Results
from glossbench.run.store import open_store
from glossbench.strict_json import loads

NEEDED = ("light", "material", "view", "method", "options", "status")  # columns of a table of cells


class Table(NamedTuple):
    """The cells of one result.

    Attributes:
        address: the folder, file or address.
        columns: the columns by name.
        remarks: what differs from a finished run.
    """

    address: str
    cells: pandas.DataFrame
    columns: Mapping[str, Column]
    remarks: Sequence[str] = ()


def read_table(where: Path | str) -> Table:
    """The table of results: a folder or address of a run, a published summary, or a .parquet beside its columns.json.

    The images of a finished run are not read.

    Raises:
        InputError: there is no such table, or it is damaged.
    """
    address = str(where)
    if address.endswith(".parquet"):
        return _read_published(address)
    opened = Results.open(where)
    cells = opened.disk.read_table("cells.parquet") if opened.disk.manifest.is_finished else None
    if cells is None:
        cells = opened.cells
    return Table(address, _check(address, cells), opened.columns, opened.remarks(cells))


def _read_published(address: str) -> Table:
    folder, _, name = address.rpartition("/")
    records = Records(open_store(folder or "."))
    if not records.store.has(name):
        raise InputError(f"there is no file {address}")
    if not records.store.has("columns.json"):
        raise InputError(f"{address}: columns.json, which says what its columns mean, is missing beside it")
    cells = records.read_table(name)
    if cells is None:
        raise InputError(f"{address} is damaged, or not a table")
    try:
        columns = columns_from_json(loads(records.store.get("columns.json")))
    except ValueError as error:
        raise InputError(f"{records.store.locate('columns.json')}: {error}") from None
    return Table(address, _check(address, cells), columns)


def _check(address: str, cells: pandas.DataFrame) -> pandas.DataFrame:
    missing = [name for name in NEEDED if name not in cells]
    if missing:
        raise InputError(f"{address} is not a table of cells: the column {missing[0]} is missing")
    return cells
