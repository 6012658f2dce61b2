"""Downloads a file and verifies its hash: the file is stored whole or not at all, a broken download is continued."""

import hashlib
import os
import time
from collections.abc import Callable
from pathlib import Path
from urllib.parse import urlsplit

import requests
from filelock import FileLock
from urllib3.exceptions import HTTPError

from glossbench.catalog.folders import DATA_VARIABLE
from glossbench.errors import InputError

TIMEOUT = (10.0, 30.0)  # [s] to connect, and to wait for the next byte
SLOWEST = 1000.0  # [bytes/s] on average over PATIENCE; below it the download is given up
PATIENCE = 60.0  # [s]
BLOCK = 1 << 12  # bytes; a block that a broken connection cuts is lost


def download(url: str, target: Path, sha256: str, size: int, progress: Callable[[int], None] = lambda n: None) -> Path:
    """Downloads the file of a URL and stores it as target.

    Bytes are gathered in `<target>.part` in the same folder. A broken download leaves this part behind, and the next
    one continues it by an HTTP range request; if the server sends the whole file instead, the part is overwritten.
    One process downloads at a time: another one waits, then finds the file.

    Args:
        sha256: hash of the file; a file with another hash is deleted.
        size: size of the file [bytes].
        progress: is called with the number of bytes received so far.

    Raises:
        InputError: the server cannot be reached or does not have the file, the download stops early, its hash is
            wrong, or the folder cannot be written.
    """
    part = target.with_name(f"{target.name}.part")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with FileLock(target.parent / ".lock"):
            if _hash_file(target) != sha256:
                if not part.exists() or part.stat().st_size != size:
                    _receive(url, part, size, progress)
                if _hash_file(part) != sha256:
                    part.unlink()
                    raise InputError(f"{url} is not the file of the catalogue: its sha256 differs; nothing is kept")
                os.replace(part, target)
    except requests.RequestException as error:
        raise InputError(f"cannot reach {host(url)}: {_find_reason(error)}; {_suggest_by_hand(target)}") from None
    except OSError as error:
        raise InputError(f"cannot write to {target.parent}: {error.strerror or error}") from None
    return target


def host(url: str) -> str:
    """The server of a URL."""
    return urlsplit(url).netloc


def _receive(url: str, part: Path, size: int, progress: Callable[[int], None]) -> None:
    """Appends the missing bytes to the part, and stops once it is longer than the size."""
    have = part.stat().st_size if part.exists() else 0
    if have > size:
        have = 0
    # A range of a compressed answer would be other bytes than those of the file.
    headers = {"Accept-Encoding": "identity", **({"Range": f"bytes={have}-"} if have else {})}
    with requests.get(url, headers=headers, stream=True, timeout=TIMEOUT) as answer:
        if have and answer.status_code == requests.codes.requested_range_not_satisfiable:
            part.unlink()  # the part is longer than the server's file, so it is not the beginning of that file
            return _receive(url, part, size, progress)
        if not answer.ok:
            status = f"{answer.status_code} {answer.reason}"
            raise InputError(f"{host(url)} answers {status} for {url}; {_suggest_by_hand(part.with_suffix(''))}")
        continued = answer.headers.get("Content-Range", "").startswith(f"bytes {have}-")
        if not (answer.status_code == 206 and continued):
            have = 0
        with part.open("ab" if have else "wb") as file:
            progress(have)
            since, before = time.monotonic(), have
            try:
                while block := answer.raw.read1(
                    BLOCK, decode_content=True
                ):  # returns the bytes that have arrived, without waiting for a whole block
                    have += file.write(block)
                    progress(have)
                    if have > size:
                        return  # the hash check refuses it
                    if (seconds := time.monotonic() - since) >= PATIENCE:
                        if have - before < SLOWEST * seconds:
                            raise InputError(
                                f"{host(url)} is too slow: it sent {have - before} bytes in {seconds:.0f} s, and the "
                                f"file has {size}; the same command goes on from there"
                            )
                        since, before = time.monotonic(), have
            except HTTPError:
                pass  # the bytes received so far are kept
    if have < size:
        raise InputError(f"{host(url)} broke off after {have} of {size} bytes; the same command goes on from there")


def _hash_file(path: Path) -> str | None:
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else None


def _suggest_by_hand(target: Path) -> str:
    return (
        f"the file may be put into {target.parent} as {target.name} by hand, or a folder that has it named by "
        f"{DATA_VARIABLE}"
    )


def _find_reason(error: requests.RequestException) -> str:
    """The innermost cause in a few words: requests wraps it in errors of the libraries that it uses."""
    if isinstance(error, requests.Timeout):
        return "no answer in time"
    cause: BaseException = error
    while cause.__context__ is not None:
        cause = cause.__context__
    return getattr(cause, "strerror", None) or str(cause)
