"""Hints for errors of the YAML parser: which character is missing, and where."""

import re

TEXTS = ("title", "source", "question", "text")  # keys whose value is free text


def hint(problem: str, lines: list[str], line: int, column: int) -> str:
    """What to write instead, for an error of the parser at a place in the file; "" if that cannot be guessed.

    Args:
        lines: the lines of the file.
        line, column: place of the error, both from 0.
    """
    text = lines[line] if line < len(lines) else ""
    before, above = text[:column], next((each for each in reversed(lines[:line]) if each.strip()), "")
    if problem.startswith("mapping values are not allowed"):
        return _hint_at_second_colon(before, text[column + 1 :].strip(), above)
    if problem.startswith("could not find expected ':'"):
        item = re.match(r"\s*[-–—]\s*(\S.*)$", text)
        return f"; a plain dash and a space begin an item: - {item[1].strip()}" if item else "; a key needs a colon"
    if ("<block end>" in problem and "scalar" in problem) or "cannot start any token" in problem:
        return "; text that begins with a sign needs quotes around all of it"
    if problem.startswith("expected alphabetic or numeric character"):
        return "; text that begins with * or & needs quotes"
    if "<block end>" in problem:
        return "; its indentation fits no key above it"
    return ""


def _hint_at_second_colon(before: str, rest: str, above: str) -> str:
    """The hint for a colon inside a value."""
    pair = re.match(r"(\s*(?:- +)*)([\w.]+): +(\S.*)$", before)
    if pair is None:
        if missing := re.match(r"\s*(?:- +)*([\w.]+):(\S+)$", above):
            return f"; a colon needs a space after it, on the line above: {missing[1]}: {missing[2]}"
        return "; it is indented deeper than the line above, whose value is complete"
    dash, key, value = pair[1].strip(), pair[2], pair[3]
    if key in TEXTS or not re.fullmatch(r"\w+", value):
        whole = f"{value}: {rest}".replace("'", "''")
        return f"; text with a colon needs quotes: {key}: '{whole}'"
    inner = f"{{{rest}}}" if re.match(r"\w+: ", rest) else rest
    return f"; on one line it is written {f'{dash} ' if dash else ''}{key}: {{{value}: {inner}}}"
