"""Registries: a name in a study or on the command line -> the class that it means."""

import importlib
import logging
import pkgutil
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from importlib.metadata import entry_points
from typing import Any, ClassVar, Generic, TypeVar

from glossbench.errors import InputError, called, nearest
from glossbench.options import Options

T = TypeVar("T", bound=Options)


class Registry(Generic[T]):
    """Classes of one kind by name.

    A class registers with `@METHODS.register("name")`. When the first name is asked for, `home` is imported (each
    module of it, if it is a package), then every entry point of `group` that an installed distribution declares:
    it names a module, or a class in one, whose import registers. A thread that asks meanwhile imports the same, which
    Python lets one thread do for all; an import that is interrupted is begun again by whoever asks next.

    Args:
        elsewhere: what else has a name that is not registered, as the end of a message; empty where nothing has.
    """

    every: ClassVar[list["Registry[Any]"]] = []

    def __init__(self, kind: str, home: str, group: str, elsewhere: Callable[[str], str] = lambda name: "") -> None:
        self.every.append(self)
        self.kind = kind
        self._home = home
        self._group = group
        self._elsewhere = elsewhere
        self._classes: dict[str, type[T]] = {}
        self._discovered = False
        self._discovering = threading.local()

    def register(self, name: str) -> Callable[[type[T]], type[T]]:
        """Class decorator: the class answers to `name` from now on."""

        def add(cls: type[T]) -> type[T]:
            taken = self._classes.get(name)
            if taken is not None and (taken.__module__, taken.__qualname__) != (cls.__module__, cls.__qualname__):
                raise InputError(
                    f"{self.kind} {name!r} is registered twice: in {taken.__module__} and {cls.__module__}"
                )
            cls.name = name
            self._classes[name] = cls
            return cls

        return add

    def names(self) -> list[str]:
        """All registered names, sorted."""
        self._discover()
        return sorted(self._classes)

    def get(self, name: str) -> type[T]:
        """The class behind a name; InputError with the nearest name when there is none."""
        self._discover()
        if not isinstance(name, str):
            made = "; it is made already: use it as it is" if isinstance(name, Options) else ""
            example = min(self._classes, default="its_name")
            raise InputError(f"a {self.kind} is asked for by its name, such as {example!r}, got {called(name)}{made}")
        if name not in self._classes:
            raise InputError(self.unknown(name))
        return self._classes[name]

    def unknown(self, name: str) -> str:
        """The message for an unknown name: what has this name elsewhere, or the nearest registered name."""
        return f"unknown {self.kind} {name!r}{self._elsewhere(name) or nearest(name, self.names())}"

    @contextmanager
    def isolated(self, only: Iterable[type[T]] | None = None) -> Iterator[None]:
        """A block whose registrations end with it: after it, the names and their classes are those of before.

        Args:
            only: the classes that are registered when the block begins; all that were registered before it, by default.
        """
        self._discover()
        before = self._classes
        self._classes = dict(before) if only is None else {cls.name: cls for cls in only}
        try:
            yield
        finally:
            self._classes = before

    def create(self, name: str, options: Mapping[str, Any]) -> T:
        """An instance of the named class with these options."""
        return self.get(name).create(options)

    def _discover(self) -> None:
        if self._discovered or getattr(self._discovering, "is_under_way", False):  # a module that is imported may ask
            return
        self._discovering.is_under_way = True
        try:
            self._import_all()
            self._discovered = True
        finally:
            self._discovering.is_under_way = False

    def _import_all(self) -> None:
        home = importlib.import_module(self._home)
        for module in pkgutil.iter_modules(getattr(home, "__path__", [])):
            importlib.import_module(f"{self._home}.{module.name}")
        for point in entry_points(group=self._group):
            known = set(self._classes)
            try:
                point.load()
            except (Exception, SystemExit) as error:  # another distribution's fault must not take every command with it
                for name in set(self._classes) - known:  # of a module that is not there after all
                    if self._classes[name].__module__ not in sys.modules:
                        del self._classes[name]
                first = (str(error).splitlines() or [""])[0]
                logging.getLogger("glossbench").warning(
                    "%s %r of %s cannot be loaded: %s: %s",
                    self.kind, point.name, point.dist.name if point.dist else "?", type(error).__name__, first,
                )  # fmt: skip
