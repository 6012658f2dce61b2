"""PLY: positions, normals, polygons and triangle strips, as text or as binary data of either byte order."""

import re
import warnings
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from glossbench.errors import InputError
from glossbench.scene.formats.polygons import Ints, Surface, triangulate
from glossbench.scene.formats.strips import split_strip

TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "int64": "i8", "uint64": "u8", "float32": "f4", "float64": "f8",
}  # fmt: skip
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
MAX_HEADER = 1 << 16


class Property(NamedTuple):
    """One value per row of an element, or a list of values if `counted`, the type of its length, is not empty."""

    name: str
    type: str
    counted: str = ""


class Element(NamedTuple):
    """Rows of properties."""

    name: str
    n_rows: int
    properties: list[Property]


class Lists(NamedTuple):
    """Rows of different length, one after the other."""

    values: NDArray[Any]
    counts: Ints


Columns = dict[str, Any]  # by property: an array (rows,) of values, or Lists


def read_ply(path: Path) -> Surface:
    """The faces and triangle strips of a .ply file as triangles.

    Element vertex: x, y, z and optional nx, ny, nz. Element face: a list vertex_indices or vertex_index, with any
    number of corners per face. Element tristrips: a list of the same name, in which -1 ends a strip. Other elements are
    ignored.

    Raises:
        InputError: the header is not valid, the file ends before the rows that its header announces, or it has no
            faces.

    Source: Turk 1994, "The PLY polygon file format".
    """
    data = path.read_bytes()
    order, elements, at = _read_header(path, data)
    body = _Text(path, data[at:]) if order == "ascii" else _Binary(path, data, at, ORDERS[order])
    columns = {element.name: body.read(element) for element in elements if element.properties}
    if "vertex" not in columns or not {"x", "y", "z"} <= columns["vertex"].keys():
        raise InputError(f"{path} has no vertices with x, y and z")
    vertices, normals = (
        np.stack([np.asarray(columns["vertex"][name], np.float64) for name in names], axis=1)
        if set(names) <= columns["vertex"].keys()
        else None
        for names in (("x", "y", "z"), ("nx", "ny", "nz"))
    )
    assert vertices is not None
    found = []
    faces = _find_indices(path, columns.get("face", {}))
    if faces is not None:
        found.append(faces.values[triangulate(str(path), vertices, *faces)])
    strips = _find_indices(path, columns.get("tristrips", {}))
    if strips is not None:
        found.append(split_strip(strips.values, strips.counts))
    if not found:
        raise InputError(f"{path} has no faces, only {len(vertices)} points")
    return Surface(vertices, np.concatenate(found), normals)


def _find_indices(path: Path, columns: Columns) -> Lists | None:
    named = [columns[name] for name in ("vertex_indices", "vertex_index") if name in columns]
    found = next((column for column in named if isinstance(column, Lists)), None)
    if found is None:
        return None
    wrong = ~(np.abs(found.values) < 2**53) | (found.values != np.floor(found.values))
    if wrong.any():
        raise InputError(
            f"{path}: PLY file whose face names vertex {found.values[wrong][0]:g}, which is not a whole number"
        )
    return Lists(found.values.astype(np.int64), found.counts)


def _read_header(path: Path, data: bytes) -> tuple[str, list[Element], int]:
    """The format, the elements, and the byte where the body begins."""
    end = re.search(rb"end_header[ \t]*(\r\n|\n|\r)", data[:MAX_HEADER])
    if not re.match(rb"(\xef\xbb\xbf)?ply\s", data) or end is None:
        raise InputError(f"{path}: not a PLY file: it must begin with the line 'ply' and a header up to 'end_header'")
    order, elements = "", list[Element]()
    for line in data[: end.start()].decode("utf-8", errors="replace").splitlines()[1:]:
        words = line.split()
        try:
            match words:
                case ["format", name, _]:
                    order = name
                case ["element", name, count]:
                    elements.append(Element(name, int(count), []))
                case ["property", "list", counted, kind, name]:
                    elements[-1].properties.append(Property(name, TYPES[kind], TYPES[counted]))
                case ["property", kind, name]:
                    elements[-1].properties.append(Property(name, TYPES[kind]))
                case ["element" | "property" | "format", *_]:
                    raise ValueError(line)
        except (ValueError, KeyError, IndexError):
            raise InputError(f"{path}: PLY file whose header cannot be read: {line.strip()[:60]!r}") from None
    if order not in ORDERS:
        raise InputError(f"{path}: PLY file of format {order!r}, must be one of {', '.join(ORDERS)}")
    if any(element.n_rows < 0 for element in elements):
        raise InputError(f"{path}: PLY file with a negative number of rows")
    return order, elements, end.end()


class _Text:
    """Reads the numbers of a text body, one element after the other."""

    def __init__(self, path: Path, data: bytes) -> None:
        self._path, self._at = path, 0
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error", DeprecationWarning)  # numpy's warning if it does not read the whole text
                self._numbers = np.fromstring(data, np.float64, sep=" ")
        except (ValueError, DeprecationWarning):
            raise InputError(f"{path}: PLY file of text that holds more than numbers") from None

    def read(self, element: Element) -> Columns:
        """The columns of an element."""
        numbers, at, names = self._numbers, self._at, element.properties
        if not any(each.counted for each in names):
            end = at + element.n_rows * len(names)
            if end > len(numbers):
                raise _make_truncation_error(self._path, element)
            self._at = end
            rows = numbers[at:end].reshape(element.n_rows, len(names))
            return {each.name: rows[:, i] for i, each in enumerate(names)}
        starts: dict[str, list[int]] = {each.name: [] for each in names}
        counts: dict[str, list[int]] = {each.name: [] for each in names}
        for _ in range(element.n_rows):
            for each in names:
                if at >= len(numbers):
                    raise _make_truncation_error(self._path, element)
                if each.counted and not 0 <= numbers[at] <= len(numbers):
                    raise _make_truncation_error(self._path, element)
                n = int(numbers[at]) if each.counted else 1
                at += bool(each.counted)
                if at + n > len(numbers):
                    raise _make_truncation_error(self._path, element)
                starts[each.name].append(at)
                counts[each.name].append(n)
                at += n
        self._at = at
        return {each.name: _gather(numbers, starts[each.name], counts[each.name], each) for each in names}


class _Binary:
    """Reads the numbers of a binary body, one element after the other."""

    def __init__(self, path: Path, data: bytes, at: int, order: str) -> None:
        self._path, self._data, self._at, self._order = path, data, at, order

    def read(self, element: Element) -> Columns:
        """The columns of an element; if all rows have lists of the same lengths, they are read at once."""
        lengths = self._read_lengths(element)
        parts: list[Any] = []
        for i, each in enumerate(element.properties):
            if each.counted:
                parts += [(f"count {i}", self._order + each.counted), (f"{i}", self._order + each.type, (lengths[i],))]
            else:
                parts.append((f"{i}", self._order + each.type))
        row = np.dtype(parts)
        end = self._at + element.n_rows * row.itemsize
        if end <= len(self._data):
            rows = np.frombuffer(self._data, row, element.n_rows, self._at)
            if all((rows[f"count {i}"] == n).all() for i, n in lengths.items()):
                self._at = end
                return {
                    each.name: Lists(rows[f"{i}"].reshape(-1), np.full(len(rows), lengths[i]))
                    if each.counted
                    else rows[f"{i}"]
                    for i, each in enumerate(element.properties)
                }
        if not lengths:
            raise _make_truncation_error(self._path, element)
        return self._read_row_by_row(element)

    def _read_lengths(self, element: Element) -> dict[int, int]:
        """The length of each list in the first row, by the number of its property."""
        at, found = self._at, {}
        for i, each in enumerate(element.properties):
            n = 1
            if each.counted:
                n, at = self._read_number(element, each, at) if element.n_rows else (0, at)
                found[i] = n
            at += n * np.dtype(each.type).itemsize
        return found

    def _read_number(self, element: Element, each: Property, at: int) -> tuple[int, int]:
        kind = np.dtype(self._order + each.counted)
        if at + kind.itemsize > len(self._data):
            raise _make_truncation_error(self._path, element)
        n = int(np.frombuffer(self._data, kind, 1, at)[0])
        at += kind.itemsize
        if n < 0 or at + n * np.dtype(each.type).itemsize > len(self._data):
            raise _make_truncation_error(self._path, element)
        return n, at

    def _read_row_by_row(self, element: Element) -> Columns:
        found: dict[str, list[NDArray[Any]]] = {each.name: [] for each in element.properties}
        at = self._at
        for _ in range(element.n_rows):
            for each in element.properties:
                n, at = self._read_number(element, each, at) if each.counted else (1, at)
                kind = np.dtype(self._order + each.type)
                if at + n * kind.itemsize > len(self._data):
                    raise _make_truncation_error(self._path, element)
                found[each.name].append(np.frombuffer(self._data, kind, n, at))
                at += n * kind.itemsize
        self._at = at
        columns: Columns = {}
        for each in element.properties:
            rows = found[each.name]
            values = np.concatenate(rows)
            columns[each.name] = Lists(values, np.array([len(row) for row in rows])) if each.counted else values
        return columns


def _gather(numbers: NDArray[np.float64], starts: list[int], counts: list[int], each: Property) -> Any:
    if not each.counted:
        return numbers[starts]
    n = np.array(counts, np.int64)
    places = np.arange(n.sum()) + np.repeat(np.array(starts, np.int64) - (np.cumsum(n) - n), n)
    return Lists(numbers[places], n)


def _make_truncation_error(path: Path, element: Element) -> InputError:
    return InputError(
        f"{path}: PLY file truncated or damaged: it ends before its {element.n_rows} rows {element.name!r}"
    )
