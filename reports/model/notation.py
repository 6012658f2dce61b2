"""Formulas in running text: the plain letters of docstrings become italics, indices and powers."""

import re
from typing import NamedTuple

SYMBOLS = {
    "Omega": "Ω", "Phi": "Φ", "alpha": "α", "omega": "ω", "theta": "θ", "phi": "φ", "rho": "ρ", "sigma": "σ", "xi": "ξ",
    "pi": "π",
}  # fmt: skip
WORDS = {
    "wi": ("ω", "i"), "wo": ("ω", "o"), "Lo": ("L", "o"), "kd": ("k", "d"), "ks": ("k", "s"), "log2": ("log", "2"),
    "log4": ("log", "4"),
}  # fmt: skip
UPRIGHT = ("cos", "sin", "tan", "log")
_TOKEN = re.compile(
    r"`(?P<code>[^`]+)`"
    r"|(?P<function>\b(?:cos|sin|tan))_(?P<angle>[a-z])\b"
    r"|\b(?P<base>[A-Za-z]+)_(?P<index>[a-z]|texel)\b"
    r"|\b(?P<word>" + "|".join(WORDS) + r")\b"
    r"|\b(?P<symbol>" + "|".join(SYMBOLS) + r")\b"
    r"|\^(?P<power>-?\w+)"
    r"|(?<![\w'’.])(?P<letter>[B-HJ-Zb-z]|(?<=[a-z,] )A|(?<=\()A)(?![\w'’])"
    r"|(?<= )(?P<sign>->|<=|>=|~|-|\.)(?= )"
    r"|(?<=\d)(?P<times>x)(?=\d)"
    r"|(?<=\()(?P<minus>-)(?=\d)"
)
SIGNS = {"->": "→", "<=": "≤", ">=": "≥", "~": "≈", "-": "−", ".": "·", "x": "×"}


class Run(NamedTuple):
    """A piece of a text in one style, "plain", "italic" or "code", with its subscript and superscript."""

    text: str
    style: str = "plain"
    sub: str = ""
    sup: str = ""


def split_runs(text: str) -> list[Run]:
    """A text in pieces: single letters and Greek names as symbols, p_h with an index, x^2 with a power, `code`.

    Longer names, such as those of options (mip_bias), stay as they are.
    """
    found: list[Run] = []
    end = 0
    for match in _TOKEN.finditer(text):
        if plain := text[end : match.start()]:
            found.append(Run(plain))
        end = match.end()
        if match["power"] and found:
            found[-1] = found[-1]._replace(sup=match["power"].replace("-", "−"))
        else:
            found += _set(match)
    return [*found, Run(text[end:])] if text[end:] else found


def _set(match: re.Match[str]) -> list[Run]:
    part = match.groupdict()
    if part["code"]:
        return [Run(part["code"], "code")]
    if part["function"]:
        return [Run(f"{part['function']}\u2009"), Run("θ", "italic", part["angle"])]
    if part["base"]:
        base = SYMBOLS.get(part["base"], part["base"])
        return [Run(base, "italic" if len(base) == 1 else "plain", part["index"])]
    if part["word"]:
        base, index = WORDS[part["word"]]
        return [Run(base, "plain" if base in UPRIGHT else "italic", index)]
    if part["symbol"]:
        return [Run(SYMBOLS[part["symbol"]], "italic")]
    if part["letter"]:
        return [Run(part["letter"], "italic")]
    return [Run(SIGNS[part["sign"] or part["minus"] or part["times"]])]
