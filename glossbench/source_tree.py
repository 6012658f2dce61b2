"""The modules of glossbench on disk, and those that a given module needs: its import closure."""

from collections.abc import Iterable, Iterator
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path

from glossbench.source_imports import ImportedName, read_source


class SourceTree:
    """The modules of one package. Each module is read once, at its first use.

    Args:
        name: name of the package.
        folder: folder of the package. A subpackage in another folder, such as `methods` in a checkout, is found with
            Python's import system.
    """

    def __init__(self, name: str, folder: Path) -> None:
        self._name, self._folder = name, folder
        self._files: dict[str, Path | None] = {}
        self._needed: dict[str, tuple[str, ...]] = {}

    def has(self, module: str) -> bool:
        """Whether a module belongs to the package, by its name."""
        return module == self._name or module.startswith(f"{self._name}.")

    def find_closure(self, starts: Iterable[ImportedName]) -> dict[str, Path]:
        """The files of the imported modules and of all that these import, at any depth, by the names of the modules.

        The `__init__.py` of a package counts if it defines the imported name. If it only imports the name from another
        module, that module counts instead: otherwise each user of one name would depend on everything that the package
        imports.
        """
        found: dict[str, Path] = {}
        waiting = [module for start in starts if self.has(start.module) for module in self._find_definitions(start)]
        while waiting:
            module = waiting.pop()
            if module not in found and (file := self._find_file(module)):
                found[module] = file
                waiting += self._find_needs(module, file)
        return found

    def _find_needs(self, module: str, file: Path) -> tuple[str, ...]:
        if module not in self._needed:
            package = module if file.stem == "__init__" else module.rpartition(".")[0]
            imports = [each for each in read_source(file, package).imports if self.has(each.module)]
            self._needed[module] = tuple({name: None for each in imports for name in self._find_definitions(each)})
        return self._needed[module]

    def _find_definitions(self, imported: ImportedName) -> Iterator[str]:
        """The modules that define what an import names."""
        module, name = imported
        file = self._find_file(module)
        names = read_source(file, module).names if file and file.stem == "__init__" else {}
        if name in names and self.has(names[name].module) and names[name] != imported:
            yield from self._find_definitions(names[name])
        elif name and self._find_file(imported.dotted):
            yield from self._find_definitions(ImportedName(imported.dotted))
        else:
            yield module
            if not name:  # every name of the package may be used
                handed_on = [each for each in names.values() if self.has(each.module) and each != imported]
                yield from (defining for each in handed_on for defining in self._find_definitions(each))

    def _find_file(self, module: str) -> Path | None:
        if module not in self._files:
            self._files[module] = self._find(module)
        return self._files[module]

    def _find(self, module: str) -> Path | None:
        top, *rest = module.split(".")[1:] or [""]
        folder = self._folder
        if top and not (folder / top).is_dir() and not (folder / f"{top}.py").is_file():
            spec = None
            with suppress(ModuleNotFoundError):  # the package is not installed
                spec = find_spec(f"{self._name}.{top}")
            if spec is None or not spec.submodule_search_locations:
                return None
            folder, top = Path(spec.submodule_search_locations[0]), ""
        stem = folder.joinpath(*filter(None, [top, *rest]))
        return next((file for file in (stem / "__init__.py", stem.with_suffix(".py")) if file.is_file()), None)


GLOSSBENCH = SourceTree("glossbench", Path(__file__).resolve().parent)
