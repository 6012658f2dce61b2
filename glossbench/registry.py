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

from glossbench.errors import InputError, describe_wrong_value, suggest_nearest
from glossbench.options import Options

T = TypeVar("T", bound=Options)


class Registry(Generic[T]):
    """Classes of one kind by name.

    A class registers with `@METHODS.register("name")`. The first request for a name imports `home` (each of its
    modules, if it is a package), then every entry point of `group` that an installed distribution declares. An entry
    point names a module, or a class in a module, whose import registers classes. Another thread that makes a request
    meanwhile imports the same; Python lets one thread do this for all. After an interrupted import, the next request
    starts it again.

    Args:
        elsewhere: for a name that is not registered, the end of a message that says what else has this name; empty if
            nothing has it.
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
        """Class decorator: registers the class under `name`."""

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
        """The class of a name. Raises InputError with the nearest name if the name is not registered."""
        self._discover()
        if not isinstance(name, str):
            made = "; it is made already: use it as it is" if isinstance(name, Options) else ""
            example = min(self._classes, default="its_name")
            raise InputError(
                f"a {self.kind} is asked for by its name, such as {example!r}, got {describe_wrong_value(name)}{made}"
            )
        if name not in self._classes:
            raise InputError(self.explain_unknown(name))
        return self._classes[name]

    def explain_unknown(self, name: str) -> str:
        """The message for an unknown name: it says what else has this name, or gives the nearest registered name."""
        return f"unknown {self.kind} {name!r}{self._elsewhere(name) or suggest_nearest(name, self.names())}"

    @contextmanager
    def isolated(self, only: Iterable[type[T]] | None = None) -> Iterator[None]:
        """A block whose registrations end with it: after it, the registry has the same names and classes as before.

        Args:
            only: the classes that are registered at the start of the block; by default all that are registered.
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
        # A module may ask for a name while it is imported.
        if self._discovered or getattr(self._discovering, "is_under_way", False):
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
            except (Exception, SystemExit) as error:  # a fault of another distribution must not stop every command
                for name in set(self._classes) - known:  # remove classes of a module whose import failed
                    if self._classes[name].__module__ not in sys.modules:
                        del self._classes[name]
                first = (str(error).splitlines() or [""])[0]
                logging.getLogger("glossbench").warning(
                    "%s %r of %s cannot be loaded: %s: %s",
                    self.kind, point.name, point.dist.name if point.dist else "?", type(error).__name__, first,
                )  # fmt: skip
