"""Compiled kernels in the user's cache folder: each is a shared library and a file of facts about it.

NAME.KEY.json   which sizes it takes, what it was compiled for, and the name and checksum of its library
CHECKSUM.so     the library

The file of facts is written last, and with a checksum. The checksum of the library is compared before it is loaded,
because loading a damaged library can end the process. Several processes may read and write the folder at once.
"""

import logging
import os
import platform
import sys
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import cache, lru_cache
from hashlib import file_digest, sha256
from pathlib import Path
from time import time
from typing import Any

import torch
from torch import Tensor

from glossbench.atomic import remove_abandoned, replacing
from glossbench.catalog.folders import cache_folder
from glossbench.errors import WriteError
from glossbench.import_closure import find_source_files, hash_of, is_installed
from glossbench.shading.kernels.arguments import Form, classes_of, text_of
from glossbench.shading.kernels.kernel import Kernel
from glossbench.strict_json import seal, unseal

BOUND = 1 << 30  # bytes of all libraries; above it, those that were not used for the longest time are removed
COMPILER = "glossbench.shading.kernels.compile"
FACTS, LIBRARIES = "[!.]*.json", "[!.]*.so"  # what begins with a dot is being written

Size = int | str  # of a dimension: a number, or the name of a number that may vary


@dataclass(frozen=True)
class Artefact:
    """The facts about a compiled kernel.

    Attributes:
        kernel: its name.
        target: what it was compiled for: version of torch, and features of the processor.
        sizes: sizes of each tensor; equal names must be equal numbers.
        ranges: for each name, the smallest and largest number that it may be.
        n_outputs: number of tensors that it returns; None if it returns one that is not in a tuple.
        seconds: processor time that the compilation took, which other work on the machine does not lengthen.
        library: name of the library's file, its SHA-256.
    """

    kernel: str
    target: str
    sizes: list[list[Size]]
    ranges: dict[str, list[int]]
    n_outputs: int | None
    seconds: float
    library: str

    def takes(self, tensors: Sequence[Tensor]) -> bool:
        """Whether it can run with tensors of these sizes."""
        found: dict[str, int] = {}
        for tensor, sizes in zip(tensors, self.sizes, strict=True):
            for n, size in zip(tensor.shape, sizes, strict=True):
                if n != (size if isinstance(size, int) else found.setdefault(size, n)):
                    return False
        return all(low <= found[name] <= high for name, (low, high) in self.ranges.items() if name in found)


def folder() -> Path:
    """The folder of compiled kernels."""
    return cache_folder() / "kernels"


@cache
def target() -> str:
    """What kernels are compiled for here: version of torch, and features of the processor."""
    features = [platform.machine(), torch.backends.cpu.get_cpu_capability()]
    with suppress(OSError, StopIteration):
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
        features.append(next(line for line in lines if line.startswith(("flags", "Features"))))
    return f"torch {torch.__version__}, {sha256(' '.join(features).encode()).hexdigest()[:16]}"


def key_of(kernel: Kernel, form: Form, tensors: Sequence[Tensor], part: str) -> str | None:
    """Hash of all that decides a compiled kernel except the sizes of dimensions; None if its source cannot be found.

    A dimension of size 1 is broadcast, and so it counts.
    """
    if kernel.place is None:
        return None
    types = tuple([(t.dtype, t.device.type, *[n == 1 for n in t.shape]) for t in tensors])
    return _hash_call(kernel.place, part, form, text_of(form), types, target())


@lru_cache(maxsize=1024)  # the text, too, because equal forms may differ: 0.0 and -0.0
def _hash_call(
    place: tuple[str, str], part: str, form: Form, text: str, types: tuple[Any, ...], compiled_for: str
) -> str | None:
    modules = {place[0], COMPILER, *(cls.__module__ for cls in classes_of(form))} - {"builtins"}
    source = _source(frozenset(modules))
    stated = [*place, part, source, text, types, compiled_for]
    return sha256(repr(stated).encode()).hexdigest()[:20] if source else None


def find(key: str, tensors: Sequence[Tensor]) -> Artefact | None:
    """The artefact of a key that takes tensors of these sizes. A damaged one is passed over, and a warning says so."""
    for path in _list_facts(*state()).get(key, ()):
        artefact = _read(path)
        if artefact is None or not artefact.takes(tensors):
            continue
        if _is_whole(artefact):
            with suppress(OSError):
                os.utime(path)  # the time of its last use
            return artefact
        warn_of(path)
    return None


def names() -> frozenset[str]:
    """The names of the kernels in the folder."""
    return _list_names(*state())


def state() -> tuple[Path, int]:
    """The folder, and the time of the last change of what is in it; what was read from it is valid until then."""
    place = folder()
    try:
        return place, place.stat().st_mtime_ns
    except OSError:  # it is not there
        return place, 0


@lru_cache(maxsize=1)  # a run looks for its kernels at each call, and others seldom write
def _list_facts(place: Path, changed: int) -> dict[str, list[Path]]:
    """The files of facts, by key."""
    found: dict[str, list[Path]] = {}
    for path in sorted(place.glob("[!.]*.*.*.json")):
        found.setdefault(path.name.split(".")[-3], []).append(path)
    return found


@lru_cache(maxsize=1)
def _list_names(place: Path, changed: int) -> frozenset[str]:
    return frozenset(path.name.rsplit(".", 3)[0] for paths in _list_facts(place, changed).values() for path in paths)


def library_of(artefact: Artefact) -> Path:
    """The path of an artefact's library."""
    return folder() / f"{artefact.library}.so"


def _is_whole(artefact: Artefact) -> bool:
    """Whether the library has the checksum that the artefact states."""
    try:
        with library_of(artefact).open("rb") as file:
            return file_digest(file, "sha256").hexdigest() == artefact.library
    except OSError:
        return False


def store(key: str, library: Path, facts: dict[str, Any]) -> Artefact:
    """Copy a compiled library into the folder, and write its facts.

    Raises:
        WriteError: the folder cannot be written.
    """
    data = library.read_bytes()
    artefact = Artefact(**facts, library=sha256(data).hexdigest())
    try:
        folder().mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise WriteError(folder(), error.strerror or str(error)) from error
    with replacing(folder() / f"{artefact.library}.so") as part:
        part.write_bytes(data)
    variant = sha256(repr(artefact.sizes).encode()).hexdigest()[:8]
    with replacing(folder() / f"{artefact.kernel}.{key}.{variant}.json") as part:
        part.write_text(seal(asdict(artefact)))
    bound(BOUND)
    return artefact


def bound(limit: int) -> None:
    """Remove the artefacts that were not used for the longest time, until all libraries together take less."""
    used = sorted(folder().glob(FACTS), key=lambda path: path.stat().st_mtime, reverse=True)
    kept, total = set(), 0
    for path in used:
        artefact = _read(path, silent=True)
        library = folder() / f"{artefact.library}.so" if artefact else None
        total += library.stat().st_size if library and library.is_file() else 0
        if library is None or total > limit:
            path.unlink(missing_ok=True)
        else:
            kept.add(library)
    for library in folder().glob(LIBRARIES):
        # Another process may have written the library, but not yet its facts.
        if library not in kept and (total > limit or not _is_new(library)):
            library.unlink(missing_ok=True)


def clear() -> int:
    """Remove all artefacts and the files of killed writers; returns the number of artefacts."""
    n = 0
    if folder().is_dir():
        remove_abandoned(folder())
        for path in [*folder().glob(FACTS), *folder().glob(LIBRARIES), *folder().glob("*.lock")]:
            n += path.suffix == ".json"
            path.unlink(missing_ok=True)
    return n


def every() -> Iterator[Artefact]:
    """All artefacts that are not damaged."""
    for path in sorted(folder().glob(FACTS)):
        if artefact := _read(path, silent=True):
            yield artefact


def _read(path: Path, silent: bool = False) -> Artefact | None:
    try:
        data = unseal(path.read_bytes())
        artefact = Artefact(**{name: data[name] for name in Artefact.__dataclass_fields__})
        if artefact.target != target():
            raise ValueError("compiled for something else")
        return artefact
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, TypeError):
        if not silent:
            warn_of(path)
        return None


@cache
def warn_of(path: Path) -> None:
    """Warn once in each process."""
    logging.getLogger("glossbench").warning(
        "%s is damaged or was compiled elsewhere: the kernel runs eagerly; `glossbench compile --clear` removes it",
        path,
    )


def _is_new(path: Path) -> bool:
    return time() - path.stat().st_mtime < 3600


@cache
def _source(modules: frozenset[str]) -> str | None:
    """Hash of the import closures of modules; None if one has no file."""
    files: dict[str, Path] = {}
    for name in sorted(modules):
        file = getattr(sys.modules.get(name), "__file__", None)
        if name == COMPILER:  # it is not imported here
            file = Path(__file__).with_name("compile.py")
        if file is None or not Path(file).is_file():
            return None
        if name.partition(".")[0] == "glossbench" or not is_installed(Path(file)):
            files |= find_source_files(name, Path(file))
    return hash_of(files)
