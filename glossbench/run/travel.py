"""The plug-ins of a study on another machine: what lies beside the study travels with the batches."""

import sys
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING

from glossbench.atomic import replacing
from glossbench.catalog.folders import cache_folder
from glossbench.import_closure import find_local_files, is_installed
from glossbench.plugins import import_plugin

if TYPE_CHECKING:
    from glossbench.study.study import Study


@dataclass(frozen=True)
class Plugins:
    """The plug-ins of a study.

    Attributes:
        names: their dotted names.
        folder: the folder of the study.
        files: the content of their files by name, below the folder from which they are imported.
        seconds: time limit of an import.
    """

    names: tuple[str, ...]
    folder: Path
    files: dict[str, bytes]
    seconds: float

    @staticmethod
    def of(study: "Study") -> "Plugins":
        """The plug-ins of a study that is loaded here."""
        files: dict[str, bytes] = {}
        for name in study.plugins:
            top = name.partition(".")[0]
            stated = getattr(sys.modules.get(top), "__file__", None)
            if stated is None or is_installed(Path(stated)):
                continue
            root = Path(stated).parent.parent if Path(stated).stem == "__init__" else Path(stated).parent
            for path in find_local_files(top, Path(stated)).values():
                if path.is_relative_to(root):
                    files[path.relative_to(root).as_posix()] = path.read_bytes()
        return Plugins(study.plugins, study.folder, files, study.time_limit)

    def load(self) -> None:
        """Import them on this machine."""
        if not self.names:
            return
        from glossbench.process.plugin_imports import loading  # late, because it imports torch

        folder = self.folder if self._are_in(self.folder) else self._write()
        for name in self.names:
            with loading(f"plugin {name!r}", self.seconds):
                import_plugin(name, folder)

    def _are_in(self, folder: Path) -> bool:
        return all(_read(folder / name) == content for name, content in self.files.items())

    def _write(self) -> Path:
        """Write the files to a folder of this user, whose name depends on their content."""
        digest = sha256(repr(sorted(self.files.items())).encode()).hexdigest()[:20]
        folder = cache_folder() / "plugins" / digest
        for name, content in self.files.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            with replacing(folder / name) as part:
                part.write_bytes(content)
        return folder


def _read(path: Path) -> bytes | None:
    try:
        return path.read_bytes()
    except OSError:
        return None
