"""The state of this process: changes that a plug-in makes to it are undone when the plug-in is done."""

import os
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, nullcontext, suppress
from functools import lru_cache
from pathlib import Path
from types import ModuleType
from typing import Any

from glossbench.errors import MethodError
from glossbench.import_closure import is_installed
from glossbench.process.settings import GENERATORS, SETTINGS, Setting
from glossbench.registry import Registry

# Modules and classes outside this package that it calls, and whose members a plug-in may replace.
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


class ProcessRestorer:
    """Context manager: after the block the process is as it was before it, even if the block raises an error.

    It restores the working folder, environment, locale, mode of new files, limits, signals, recursion limit, standard
    streams, hooks, logging and warnings; members of this package and of the modules that it calls; switches and
    generators of torch and numpy. Threads that the block starts do not keep the process alive. If the block forks, the
    child process ends at the end of the block, and only the original process leaves it.

    Args:
        by: name of the plug-in that runs in the block, for messages.
        but: modules whose members are not restored.

    Raises:
        MethodError: something cannot be restored.
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
        owners = [owner for owner in _find_owners(self._modules) if owner.__name__ not in self._but]
        self._members = [(owner, vars(owner).copy()) for owner in owners]  # dict() would look up each member of a class
        self._settings = [(setting, _read_value(setting)) for setting in (*SETTINGS, *GENERATORS)]
        threading.Thread.start = _make_daemonic(self._thread, threading.Thread.start)  # type: ignore[method-assign]

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        sys.setrecursionlimit(self._recursion)  # first, because what follows needs nested calls
        if os.getpid() != self._pid:
            os._exit(1)
        self._restore_modules()
        failed = [*self._restore_members(), *self._restore_streams()]
        for setting, before in self._settings:
            try:
                if before is not _NOTHING and (setting in GENERATORS or setting.get() != before):
                    setting.put(before)
            except Exception:
                failed.append(setting.what)
        if failed and error is None:
            raise MethodError(f"{self._by} changes {', '.join(failed)} of this process, which cannot be put back")

    def _restore_modules(self) -> None:
        """Put back entries that sys.modules and the registries have lost, except modules of plug-ins.

        Plug-ins may change and are loaded again.
        """
        for name in self._modules.keys() - sys.modules.keys():
            module = self._modules[name]
            file = getattr(module, "__file__", None)
            if not isinstance(file, str) or is_installed(Path(file)):
                sys.modules[name] = module
        for registry, classes in self._registered:
            for name, cls in classes.items():
                registry._classes.setdefault(name, cls)

    def _restore_members(self) -> Iterator[str]:
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

    def _restore_streams(self) -> Iterator[str]:
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
    """Whether all members are the same, in one comparison, because most owners do not change."""
    try:
        return bool(now == before)
    except Exception:  # some members cannot be compared, such as tensors
        return False


def _is_inherited(owner: ModuleType | type, name: str) -> bool:
    """Whether a class inherits a member, which an own member of the same name would hide."""
    return isinstance(owner, type) and any(name in vars(base) for base in owner.__mro__[1:])


_NOTHING = object()


def _read_value(setting: Setting) -> Any:
    """The value of a setting; _NOTHING if it does not exist any more, such as a deleted working folder."""
    try:
        return setting.get()
    except OSError:
        return _NOTHING


def _dup(fd: int) -> int | None:
    try:
        return os.dup(fd)
    except OSError:  # it was closed when the process started
        return None


def _is_same(fd: int, kept: int) -> bool:
    try:
        a, b = os.fstat(fd), os.fstat(kept)
    except OSError:
        return False
    return (a.st_dev, a.st_ino) == (b.st_dev, b.st_ino)


def _make_daemonic(of: int, start: Callable[..., None]) -> Callable[..., None]:
    """A Thread.start with which threads do not keep the process alive if the thread `of` starts them.

    The same holds for the threads that those start.
    """

    def run(self: threading.Thread) -> None:
        if threading.get_ident() == of:
            with suppress(RuntimeError):  # it runs already
                self.daemon = True
            vars(self)["is_of_plugin"] = True
        start(self)

    return run


def is_foreign(cls: type) -> bool:
    """Whether a class belongs to a plug-in."""
    return cls.__module__.partition(".")[0] != "glossbench"


def guarded(cls: type) -> AbstractContextManager[None]:
    """The context for calls of a class: `ProcessRestorer` for a plug-in's class, as ours do not change the process."""
    return ProcessRestorer(cls.__name__) if is_foreign(cls) else nullcontext()


def _find_owners(loaded: dict[str, ModuleType]) -> tuple[ModuleType | type, ...]:
    """Modules and classes whose members must not change: those that this package calls, and its own."""
    called = [loaded[name] for name in _CALLED if isinstance(loaded.get(name), ModuleType)]
    ours = [module for name, module in loaded.items() if name.startswith("glossbench") and name[10:11] in ("", ".")]
    return _add_classes((*called, *ours), len(called))


@lru_cache(maxsize=1)  # the walk over all members takes milliseconds, for each cell of a plug-in several times
def _add_classes(modules: tuple[ModuleType, ...], n_called: int) -> tuple[ModuleType | type, ...]:
    """The modules, the classes that those after the first `n_called` define, and those of `_CLASSES`."""
    own = [
        member
        for module in modules[n_called:]
        for member in dict(vars(module)).values()
        if isinstance(member, type) and member.__module__ == module.__name__
    ]
    called = [getattr(sys.modules.get(path.rpartition(".")[0]), path.rpartition(".")[2], None) for path in _CLASSES]
    return (*modules, *own, *(cls for cls in called if isinstance(cls, type)))
