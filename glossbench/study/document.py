"""YAML with positions: plain data, and the place of each key and value in its file."""

import re
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, get_args

import yaml
from pydantic import BaseModel, ValidationError

from glossbench.errors import InputError, suggest_nearest
from glossbench.rules import state_rule, suggest_instead
from glossbench.study.yaml_hints import hint

KeyPath = tuple[str | int, ...]
MAX_BYTES = 1_000_000
MAX_NODES = 100_000  # an alias counts at each use, so that a few lines cannot expand to gigabytes
MAX_DEPTH = 64
MAX_MESSAGE = 500


@dataclass(frozen=True)
class Document:
    """The contents of a YAML file, with their positions.

    Attributes:
        file: the name of the file in messages.
        data: the mapping at the top, as plain dictionaries, lists and scalars.
        values: (line, column) of the value at a path of keys and indices; both count from 1.
        keys: the same for the key that ends a path.
    """

    file: str
    data: dict[str, Any] = field(default_factory=dict)
    values: dict[KeyPath, tuple[int, int]] = field(default_factory=dict)
    keys: dict[KeyPath, tuple[int, int]] = field(default_factory=dict)

    def make_error(self, path: KeyPath, text: str, at_key: bool = False) -> InputError:
        """InputError `FILE:LINE:COLUMN: text` at a value, at its key, or at the nearest parent that is in the file."""
        marks = self.keys if at_key and path in self.keys else self.values
        while path and path not in marks:
            path = path[:-1]
        return _make_error(self.file, *marks.get(path, (1, 1)), text)

    def validate(self, model: type[BaseModel], path: KeyPath = ()) -> Any:
        """The model of the mapping at a path; InputError for its first error."""
        value: Any = self.data
        for part in path:
            value = value[part]
        if not isinstance(value, dict):
            raise self.make_error(path, f"{format_path(path)} must be a mapping, got {value!r}")
        try:
            return model.model_validate(value)
        except ValidationError as error:
            wrong = error.errors()
        unknown = [e for e in wrong if e["type"] == "extra_forbidden"]
        if unknown:  # a misspelt key gives two errors, an unknown key and a missing one; the first is more useful
            within = [e["loc"][-1] for e in unknown if e["loc"][:-1] == unknown[0]["loc"][:-1]]
            known = _list_fields(model, unknown[0]["loc"][:-1])
            raise self.make_unknown_error((*path, *unknown[0]["loc"][:-1]), "key", list(map(str, within)), known)
        first = wrong[0]
        at: KeyPath = (*path, *self._strip_type_names(first["loc"], value))
        if first["type"] == "missing":
            parent = f"{format_path(at)}: " if at else ""
            raise self.make_error(at, f"{parent}key {first['loc'][-1]!r} is required")
        rule = state_rule(first)
        raise self.make_error(at, f"{format_path(at)} {rule}{suggest_instead(rule, first['input'])}")

    def make_unknown_error(self, path: KeyPath, what: str, names: list[str], known: Collection[str]) -> InputError:
        """InputError for the unknown names in the mapping at a path, all in one line."""
        parent = f"{format_path(path)}: " if path else ""
        told = [f"unknown {what} {names[0]!r}{_suggest_name(names[0], known)}"]
        for name in names[1:]:
            line, _ = self.keys.get((*path, name), (1, 1))
            told.append(f"and {name!r} on line {line}{_suggest_name(name, known)}")
        return self.make_error((*path, names[0]), parent + "; ".join(told), at_key=True)

    @staticmethod
    def _strip_type_names(loc: tuple[int | str, ...], value: Any) -> KeyPath:
        """A location without the parts that are not keys of the data: pydantic adds names of types that it tried."""
        found: list[int | str] = []
        for part in loc:
            if isinstance(value, dict) and part in value:
                found.append(part)
                value = value[part]
            elif isinstance(value, list | tuple) and isinstance(part, int) and part < len(value):
                found.append(part)
                value = value[part]
        return tuple(found)


def format_path(path: KeyPath) -> str:
    """A path as text: methods[0].regular_sampling.samples."""
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in path).removeprefix(".")


def read_document(path: Path) -> Document:
    """The YAML file at a path; its top must be a mapping.

    Scalars follow the core schema of YAML 1.2: 1e-3 is a number, yes and 12:30 are text. Keys must be unique.

    Raises:
        InputError: the file cannot be read, is not YAML, or exceeds MAX_BYTES, MAX_NODES or MAX_DEPTH.
    """
    file = str(path)
    try:
        if path.exists() and not path.is_file() and not path.is_dir():  # a read from a pipe may wait forever
            raise InputError(f"cannot read the study {file!r}: it is a device or pipe")
        with path.open("rb") as stream:
            content = stream.read(MAX_BYTES + 1)
    except OSError as error:
        raise InputError(f"cannot read the study {file!r}: {error.strerror}") from None
    if len(content) > MAX_BYTES:
        raise _make_error(file, 1, 1, f"the file is larger than {MAX_BYTES} bytes")
    root = _compose(file, _decode(file, content))
    if root is None:
        raise _make_error(file, 1, 1, "the file is empty")
    document = Document(file)
    if not isinstance(root, yaml.MappingNode):
        kind = "a list" if isinstance(root, yaml.SequenceNode) else f"{root.value!r}"
        raise _make_error(file, *_locate_mark(root.start_mark), f"the top must be a mapping of keys, got {kind}")
    document.data.update(_Builder(document).build(root, ()))
    return document


def dump(data: Any) -> str:
    """YAML text that read_document reads back as the same data."""
    return yaml.dump(data, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=110)


def _make_error(file: str, line: int, column: int, text: str) -> InputError:
    line_text = " ".join(text.split())
    if len(line_text) > MAX_MESSAGE:
        line_text = f"{line_text[:MAX_MESSAGE]}..."
    return InputError(f"{file}:{line}:{column}: {line_text}")


def _locate_mark(mark: Any) -> tuple[int, int]:
    return mark.line + 1, mark.column + 1


def _decode(file: str, content: bytes) -> str:
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        before = content[: error.start].decode("utf-8", errors="replace")
        raise _make_error(file, *_find_line_column(before), f"byte 0x{content[error.start]:02x} is not UTF-8") from None


def _find_line_column(before: str) -> tuple[int, int]:
    return before.count("\n") + 1, len(before) - before.rfind("\n")


def _compose(file: str, text: str) -> Any:
    try:
        return yaml.compose(text, Loader=_Loader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        problem = error.problem or error.context or "not YAML"
        lines = text.splitlines()
        if mark.index < len(text) and text[mark.index] == "\t":
            indents = not lines[mark.line][: mark.column].strip()
            problem = "a tab cannot indent; use spaces" if indents else "a tab is not allowed here; use a space"
        elif problem.startswith("could not find expected ':'"):  # the parser notices this only on a later line
            mark = error.context_mark or mark
        raise _make_error(file, *_locate_mark(mark), problem + hint(problem, lines, mark.line, mark.column)) from None
    except yaml.reader.ReaderError as error:
        bad = ord(error.character) if isinstance(error.character, str) else error.character
        place = _find_line_column(text[: error.position])
        raise _make_error(file, *place, f"character U+{bad:04X} is not allowed in YAML") from None
    except RecursionError:
        raise _make_error(file, 1, 1, f"the file is nested more than {MAX_DEPTH} levels deep") from None


class _Builder:
    """Turns composed nodes into plain data, and records their positions in a document."""

    def __init__(self, document: Document) -> None:
        self._document = document
        self._n_nodes = 0

    def build(self, node: yaml.Node, path: KeyPath) -> Any:
        self._n_nodes += 1
        self._document.values[path] = _locate_mark(node.start_mark)
        if self._n_nodes > MAX_NODES:
            raise self._document.make_error(path, f"more than {MAX_NODES} values, aliases counted at each use")
        if len(path) > MAX_DEPTH:
            raise self._document.make_error(path, f"more than {MAX_DEPTH} levels deep, or an alias inside itself")
        if isinstance(node, yaml.MappingNode):
            return self._build_mapping(node, path)
        if isinstance(node, yaml.SequenceNode):
            return [self.build(child, (*path, i)) for i, child in enumerate(node.value)]
        return self._build_scalar(node)

    def _build_mapping(self, node: yaml.MappingNode, path: KeyPath) -> dict[str, Any]:
        found: dict[str, Any] = {}
        for key_node, value_node in node.value:
            place = _locate_mark(key_node.start_mark)
            parent = f"{format_path(path)}: " if path else ""
            key = self._build_scalar(key_node) if isinstance(key_node, yaml.ScalarNode) else None
            if not isinstance(key, str):
                before = list(found.values())[-1:]
                is_fraction = isinstance(key, int) and before and isinstance(before[0], int)
                instead = f"; a number has a point and not a comma: {before[0]}.{key_node.value}" if is_fraction else ""
                got = f"{parent}a key must be text, got {key_node.value!r:.40}{instead}"
                raise _make_error(self._document.file, *place, got)
            if key == "<<":
                merged = (
                    f"{parent}keys cannot be merged by <<; write them out, or an alias for a whole value, key: *name"
                )
                raise _make_error(self._document.file, *place, merged)
            if key in found:
                first = self._document.keys[(*path, key)][0]
                raise _make_error(self._document.file, *place, f"{parent}key {key!r} is already on line {first}")
            self._document.keys[(*path, key)] = place
            found[key] = self.build(value_node, (*path, key))
        return found

    def _build_scalar(self, node: yaml.Node) -> Any:
        tag = node.tag.removeprefix("tag:yaml.org,2002:")
        place = _locate_mark(node.start_mark)
        surrogate = next((c for c in node.value if "\ud800" <= c <= "\udfff"), None)
        if surrogate:  # from an escape; no file, terminal or page could show it
            raise _make_error(self._document.file, *place, f"U+{ord(surrogate):04X} is half a character")
        if tag not in _SCALARS:
            raise _make_error(self._document.file, *place, f"tag {node.tag!r} is not allowed")
        try:
            return _SCALARS[tag](node.value)
        except ValueError:
            zeros = f"; write {node.value.lstrip('0') or 0}, or 0o{node.value.lstrip('0')} for base 8"
            instead = zeros if re.fullmatch(r"0[0-9]+", node.value) else ""
            raise _make_error(
                self._document.file, *place, f"{node.value!r:.40} is not a valid {tag}{instead}"
            ) from None


def _list_fields(model: type[BaseModel], loc: tuple[int | str, ...]) -> list[str]:
    """The keys of the model that is nested in another model at a location."""
    for part in loc:
        if isinstance(part, str) and part in model.model_fields:
            annotation = model.model_fields[part].annotation
            model = next(c for c in (annotation, *get_args(annotation)) if isinstance(c, type))
    return list(model.model_fields)


def _suggest_name(name: str, known: Collection[str]) -> str:
    """The hint for an unknown name. A key and value with no space after the colon are read as one name."""
    key, colon, value = name.partition(":")
    if colon and key in known:
        return f"; a colon needs a space after it: {key}: {value}"
    return suggest_nearest(name, known)


def _parse_int(text: str) -> int:
    if re.fullmatch(r"[-+]?0[0-9]+", text):
        raise ValueError("a number cannot begin with 0")
    return int(text, {"0x": 16, "0o": 8}.get(text[:2], 10))


def _parse_float(text: str) -> float:
    return float(re.sub(r"\.(inf|nan)", r"\1", text.lower()))


_SCALARS: dict[str, Callable[[str], Any]] = {
    "null": lambda text: None,
    "bool": lambda text: text.lower() == "true",
    "int": _parse_int,
    "float": _parse_float,
    "str": str,
}
_FLOAT = r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)"
_CORE = [  # YAML 1.2.2, chapter 10.3.2: the first pattern that fits gives the tag
    ("null", r"~|null|Null|NULL|", ["~", "n", "N", ""]),
    ("bool", r"true|True|TRUE|false|False|FALSE", list("tTfF")),
    ("int", r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+", list("-+0123456789")),
    ("float", _FLOAT, list("-+.0123456789")),
]


class _Loader(yaml.SafeLoader):
    yaml_implicit_resolvers: dict[str, Any] = {}  # noqa: RUF012  (PyYAML's own name and kind)


class _Dumper(yaml.SafeDumper):
    yaml_implicit_resolvers: dict[str, Any] = {}  # noqa: RUF012

    def ignore_aliases(self, data: Any) -> bool:
        return True


for _tag, _pattern, _starts in _CORE:
    for _class in (_Loader, _Dumper):
        _class.add_implicit_resolver(f"tag:yaml.org,2002:{_tag}", re.compile(f"^(?:{_pattern})$"), _starts)
