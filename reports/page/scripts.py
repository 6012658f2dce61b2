"""Scripts of a page: modules of several files each, inlined, and named by their hashes in the page's policy."""

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
        source: as it stands between the tags, to the byte, or its hash is another.
        hash: what the page's Content-Security-Policy knows it by: a script without one there does not run.
    """

    source: Markup
    hash: str


def join_module(names: Sequence[str]) -> Script:
    """Files of the templates, joined in this order into one module: they share a scope, and no other module's."""
    source = "\n" + "\n".join((TEMPLATES / name).read_text(encoding="utf-8") for name in names)
    return Script(Markup(source), f"sha256-{b64encode(sha256(source.encode()).digest()).decode()}")


def state_policy(scripts: Sequence[Script]) -> str:
    """The page may run these scripts, and what they add, show images that it holds, and nothing else."""
    allowed = " ".join(f"'{script.hash}'" for script in scripts)
    return (
        "default-src 'none'; base-uri 'none'; form-action 'none'; img-src data: blob:; style-src 'unsafe-inline'; "
        f"script-src 'strict-dynamic' {allowed}"
    )
