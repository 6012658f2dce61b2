"""Files next to a page: images of large studies, as scripts, and the table of cells as CSV."""

from base64 import b64encode
from collections.abc import Collection

from glossbench.run.results import Results

FOLDER = "report_images"
TABLE = "cells.csv"
INLINE_CSV = 1_000_000  # largest table that is stored in the page [bytes]


def write_script(results: Results, name: str, data: bytes) -> str:
    """Write an image as a script for the page. A file of this name is replaced: an unknown script would run."""
    store, file = results.store, f"{name}.js"
    script = f'glossbenchImage("{name}","{b64encode(data).decode()}")\n'.encode()
    if not store.has(f"{FOLDER}/{file}") or store.get(f"{FOLDER}/{file}") != script:
        store.put(f"{FOLDER}/{file}", script)
    return file


def link_csv(results: Results, csv: bytes) -> tuple[str, frozenset[str]]:
    """The target of a link to a table; and the names of files written for it.

    Raises:
        InputError: a file of this name exists and was not written by glossbench.
    """
    if len(csv) <= INLINE_CSV:
        return f"data:text/csv;charset=utf-8;base64,{b64encode(csv).decode()}", frozenset()
    results.disk.own(f"{FOLDER}/{TABLE}")
    results.store.put(f"{FOLDER}/{TABLE}", csv)
    return f"{FOLDER}/{TABLE}", frozenset([TABLE])


def remove_others(results: Results, files: Collection[str]) -> None:
    """Remove files of an older page that this program wrote; to be called after the new page is written."""
    for ending in (".js", ".csv"):
        results.disk.keep_only(ending, FOLDER, [name for name in files if name.endswith(ending)])
