"""The state of this process: what a plug-in changes of it is put back once the plug-in is done."""

import os
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, nullcontext, suppress
from pathlib import Path
from types import ModuleType
from typing import Any

from glossbench.errors import MethodError
from glossbench.import_closure import is_installed
from glossbench.process.settings import GENERATORS, SETTINGS, Setting
from glossbench.registry import Registry

# Beside this package: modules and classes that it calls, whose members a plug-in may replace.
_CALLED = (
    "builtins", "io", "json", "json.decoder", "json.encoder", "os", "os.path", "time", "math", "zlib", "hashlib",
    "shutil", "tempfile", "threading", "signal", "random", "struct", "copy", "dataclasses", "inspect", "functools",
    "contextlib", "datetime", "traceback", "warnings", "logging", "importlib", "pathlib", "re", "socket",
    "sys", "gc", "faulthandler", "subprocess", "uuid", "numpy", "numpy.linalg", "torch", "torch.nn.functional",
    "torch.quasirandom", "scipy.optimize", "pandas", "pyarrow", "pyarrow.parquet", "pydantic", "yaml", "OpenEXR",
    "PIL.Image",
)  # fmt: skip
_CLASSES = (
    "pathlib.Path", "pathlib.PurePath", "pathlib.PosixPath", "torch.Tensor", "torch.quasirandom.SobolEngine",
    "threading.Thread", "json.encoder.JSONEncoder", "pandas.DataFrame", "PIL.Image.Image", "yaml.SafeDumper",
    "yaml.SafeLoader", "pyarrow.parquet.ParquetWriter", "pydantic.BaseModel", "pydantic.TypeAdapter",
)  # fmt: skip
_LEFT = {("sys", name) for name in ("last_type", "last_value", "last_traceback", "last_exc", "ps1", "ps2")}


class Restored:
    """Context manager: the process is after the block as it was before it, whatever happens inside.

    That is: working folder, environment, locale, mode of new files, limits, signals, recursion limit, standard streams,
    hooks, logging and warnings; members of this package and of the modules that it calls; torch's and numpy's switches
    and generators. Threads that the block starts do not keep the process alive; of a process that it forks, none but
    the first leaves the block.

    Args:
        by: whose block it is, for messages.
        but: modules whose members stay as the block leaves them.

    Raises:
        MethodError: something cannot be put back.
    """

    def __init__(self, by: str, but: tuple[str, ...] = ()) -> None:
        self._by, self._but = by, but

    def __enter__(self) -> None:
        self._pid, self._thread = os.getpid(), threading.get_ident()
        self._recursion = sys.getrecursionlimit()
        self._streams = [(fd, _dup(fd)) for fd in (0, 1, 2)]
        self._files = {name: getattr(sys, name) for name in ("stdin", "stdout", "stderr")}
        self._modules = dict(sys.modules)
        self._registered = [(registry, dict(registry._classes)) for registry in Registry.every]
        self._members = [(owner, dict(vars(owner))) for owner in _owners() if owner.__name__ not in self._but]
        self._settings = [(setting, _now(setting)) for setting in (*SETTINGS, *GENERATORS)]
        threading.Thread.start = _daemonic(self._thread, threading.Thread.start)  # type: ignore[method-assign]

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        sys.setrecursionlimit(self._recursion)  # before anything that calls deeper
        if os.getpid() != self._pid:
            os._exit(1)
        self._modules_put_back()
        failed = [*self._members_put_back(), *self._streams_put_back()]
        for setting, before in self._settings:
            try:
                if before is not _NOTHING and (setting in GENERATORS or setting.get() != before):
                    setting.put(before)
            except Exception:
                failed.append(setting.what)
        if failed and error is None:
            raise MethodError(f"{self._by} changes {', '.join(failed)} of this process, which cannot be put back")

    def _modules_put_back(self) -> None:
        """What sys.modules and the registries have lost, but for modules of somebody: these change and are reloaded."""
        for name, module in self._modules.items():
            file = getattr(module, "__file__", None)
            if name not in sys.modules and (not isinstance(file, str) or is_installed(Path(file))):
                sys.modules[name] = module
        for registry, classes in self._registered:
            for name, cls in classes.items():
                registry._classes.setdefault(name, cls)

    def _members_put_back(self) -> Iterator[str]:
        for owner, before in self._members:
            now = vars(owner)
            if _is_equal(now, before):
                continue
            for name in [n for n in now if n not in before and _is_inherited(owner, n)]:
                delattr(owner, name)
            for name, value in before.items():
                if now.get(name, self) is not value and (owner.__name__, name) not in _LEFT:
                    try:
                        setattr(owner, name, value)
                    except (AttributeError, TypeError):
                        yield f"{owner.__name__}.{name}"

    def _streams_put_back(self) -> Iterator[str]:
        for fd, kept in self._streams:
            if kept is None:
                continue
            try:
                if not _is_same(fd, kept):
                    os.dup2(kept, fd)
            except OSError:
                yield f"stream {fd}"
            with suppress(OSError):
                os.close(kept)
        for fd, (name, file) in enumerate(self._files.items()):
            if getattr(file, "closed", False) and not sys.is_finalizing():
                with suppress(OSError):
                    file = open(fd, "r" if fd == 0 else "w", encoding=file.encoding, errors=file.errors,
                                   closefd=False, buffering=1)  # fmt: skip
            setattr(sys, name, file)


def _is_equal(now: Mapping[str, Any], before: Mapping[str, Any]) -> bool:
    """Whether members are the same, at once: most are."""
    try:
        return bool(now == before)
    except Exception:  # of members that do not compare, as tensors
        return False


def _is_inherited(owner: ModuleType | type, name: str) -> bool:
    """Whether a class has a member from a base, which one of its own would hide."""
    return isinstance(owner, type) and any(name in vars(base) for base in owner.__mro__[1:])


_NOTHING = object()


def _now(setting: Setting) -> Any:
    """What a setting is; nothing where the process has it no more, as a working folder that is gone."""
    try:
        return setting.get()
    except OSError:
        return _NOTHING


def _dup(fd: int) -> int | None:
    try:
        return os.dup(fd)
    except OSError:  # closed from the start
        return None


def _is_same(fd: int, kept: int) -> bool:
    try:
        a, b = os.fstat(fd), os.fstat(kept)
    except OSError:
        return False
    return (a.st_dev, a.st_ino) == (b.st_dev, b.st_ino)


def _daemonic(of: int, start: Callable[..., None]) -> Callable[..., None]:
    """Thread.start, by which threads that one thread starts, and those of these, do not keep the process alive."""

    def run(self: threading.Thread) -> None:
        if threading.get_ident() == of:
            with suppress(RuntimeError):  # it runs already
                self.daemon = True
            vars(self)["is_of_plugin"] = True
        start(self)

    return run


def is_foreign(cls: type) -> bool:
    """Whether a class is a plug-in's."""
    return cls.__module__.partition(".")[0] != "glossbench"


def guarded(cls: type) -> AbstractContextManager[None]:
    """What a call of a class runs in: of a plug-in's, `Restored`; our own leave the process as it is."""
    return Restored(cls.__name__) if is_foreign(cls) else nullcontext()


def _owners() -> Iterator[ModuleType | type]:
    """Modules and classes whose members must stay: those that this package calls, and its own."""
    loaded = dict(sys.modules)
    yield from (loaded[name] for name in _CALLED if isinstance(loaded.get(name), ModuleType))
    yield from _ours()
    for module in _ours():
        yield from (v for v in dict(vars(module)).values() if isinstance(v, type) and v.__module__ == module.__name__)
    for path in _CLASSES:
        module_name, _, name = path.rpartition(".")
        cls = getattr(sys.modules.get(module_name), name, None)
        if isinstance(cls, type):
            yield cls


def _ours() -> list[ModuleType]:
    return [
        module for name, module in dict(sys.modules).items() if name == "glossbench" or name.startswith("glossbench.")
    ]
