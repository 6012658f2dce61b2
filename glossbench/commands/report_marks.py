"""Marks of reports: whether a new report would equal the one that is there, so that a run need not write it again."""

from collections.abc import Iterator
from contextlib import suppress
from hashlib import sha256
from importlib.metadata import distributions, entry_points
from importlib.util import find_spec
from pathlib import Path

from glossbench.errors import InputError
from glossbench.run.folder import Folder
from glossbench.run.manifest import KEPT, SUMMARY
from glossbench.run.results import Results
from glossbench.strict_json import dumps, loads

NAME = "reports.json"
WRITERS = ("glossbench", "glossbench.reports", "glossbench.data")  # packages that a report is made by


class ReportMarks:
    """The marks of the reports in one folder of results: for each, what it was made of, and its checksum.

    A report is made of the tables and verdicts of a finished run, of glossbench and of the installed distributions.
    What plug-ins add to it is not known here: with plug-ins of a study or of another distribution, and in a store that
    is no folder, nothing is marked.
    """

    def __init__(self, results: Results) -> None:
        self._disk = results.disk
        self._source = _digest_source(results)

    def find_current(self, name: str) -> Path | str | None:
        """The path of the report of this name if it is as this version wrote it for the same results, else None."""
        file = f"report.{name}"
        if self._source is None or not all(map(self._disk.store.has, [file, *self._disk.manifest.files])):
            return None
        return self._disk.store.locate(file) if self._read().get(name) == self._mark(file) else None

    def add(self, name: str) -> None:
        """Mark the report of this name, which was written now."""
        if self._source is None:
            return
        with suppress(InputError):  # a file of this name is another program's: then every run writes the report
            self._disk.own(NAME)
            self._disk.write(NAME, dumps({**self._read(), name: self._mark(f"report.{name}")}))

    def _mark(self, file: str) -> dict[str, str | None]:
        return {"source": self._source, "report": self._disk.compute_checksum(file)}

    def _read(self) -> dict[str, object]:
        with suppress(OSError, ValueError):
            read = loads(self._disk.store.get(NAME))
            return read if isinstance(read, dict) else {}
        return {}


def _digest_source(results: Results) -> str | None:
    """SHA-256 of what reports are made of; None if that is not known."""
    manifest = results.disk.manifest
    if not isinstance(results.store, Folder) or not manifest.is_finished or results.disk.is_altered("study.yaml"):
        return None
    groups = [group for group in entry_points().groups if group.startswith("glossbench.")]
    makers = {point.dist and point.dist.name for group in groups for point in entry_points(group=group)}
    if makers != {"glossbench"} or results.study.get("plugins"):
        return None
    of_results = [f"{name} {manifest.files.get(name)}" for name in (*SUMMARY, *KEPT)]
    installed = sorted(f"{each.name} {each.version}" for each in distributions())
    return sha256("\n".join([*of_results, *installed, *_list_sources()]).encode()).hexdigest()


def _list_sources() -> Iterator[str]:
    """Each file of the packages in WRITERS, with its size and the time of its last change."""
    for package in WRITERS:
        spec = find_spec(package)
        for place in (spec and spec.submodule_search_locations) or ():
            for path in sorted(Path(place).rglob("*")):
                if path.is_file() and path.suffix != ".pyc":
                    stat = path.stat()
                    yield f"{path} {stat.st_size} {stat.st_mtime_ns}"
