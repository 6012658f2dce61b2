"""Scripts of a page: inline modules of several files each, whose hashes are listed in the page's policy."""

from base64 import b64encode
from collections.abc import Sequence
from hashlib import sha256
from pathlib import Path
from typing import NamedTuple

from markupsafe import Markup

TEMPLATES = Path(__file__).parent / "templates"


class Script(NamedTuple):
    """One module of a page.

    Attributes:
        source: the exact bytes between the tags, from which the hash is computed.
        hash: its entry in the page's Content-Security-Policy; a script without one does not run.
    """

    source: Markup
    hash: str


def join_module(names: Sequence[str]) -> Script:
    """Files of the templates, joined in this order into one module; the files of a module share one scope."""
    source = "\n" + "\n".join((TEMPLATES / name).read_text(encoding="utf-8") for name in names)
    return Script(Markup(source), f"sha256-{b64encode(sha256(source.encode()).digest()).decode()}")


def state_policy(scripts: Sequence[Script]) -> str:
    """A policy by which the page may only run these scripts, run scripts that they add, and show its own images."""
    allowed = " ".join(f"'{script.hash}'" for script in scripts)
    return (
        "default-src 'none'; base-uri 'none'; form-action 'none'; img-src data: blob:; style-src 'unsafe-inline'; "
        f"script-src 'strict-dynamic' {allowed}"
    )
