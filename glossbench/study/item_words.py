"""A single word in place of an item of a study: a name or a file, and what to write instead of an unknown one."""

from pathlib import Path
from typing import Any

from glossbench.brdf.measured_file import resolve_material
from glossbench.envmap.lights.file_light import resolve_light
from glossbench.scene.mesh_view import resolve_view
from glossbench.study.registries import REGISTRIES
from glossbench.study.schema import ENDINGS

# For each kind that may be stated by the bare name of a file: how to read a word.
WORDS = {"light": resolve_light, "material": resolve_material, "view": resolve_view}


def explain_unknown(kind: str, name: str, stated: Any) -> str:
    """The message for an unknown name: how to write a file, the endings of such files, or the nearest name."""
    if isinstance(stated, str) and kind in WORDS:
        meant, option = WORDS[kind](stated)
        if option:
            unknown = REGISTRIES[kind].explain_unknown(name).partition(";")[0]
            return f"{unknown}; write {stated}, or {meant}: {format_flow(option)}"
    if ENDINGS.get(kind) and Path(name).suffix:
        return f"unknown {kind} {name!r}; a file that is a {kind} ends in {', '.join(ENDINGS[kind])}"
    return REGISTRIES[kind].explain_unknown(name)


def format_flow(options: dict[str, Any]) -> str:
    """Options in the flow style of YAML."""
    return f"{{{', '.join(f'{key}: {value}' for key, value in options.items())}}}"
