"""Messages of pydantic about a wrong value, in our words: the rule, the value, and what to write instead."""

import re
from collections.abc import Mapping
from typing import Any

from glossbench.errors import find_nearest

_WORDS = (
    (r"^Value error, |^Input ", ""),
    (r"\b(List|Tuple|Dictionary) should have", "must have"),
    (r" after validation", ""),
    (r"should", "must"),
    (r"a valid tuple", "a list"),
    (r"a valid dictionary( or instance of \w+)?", "a mapping"),
)
LONGEST = 60  # characters of a mapping that a message repeats
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"


def state_rule(error: Mapping[str, Any]) -> str:
    """The rule and the value of one error of a pydantic ValidationError: "must be a valid integer, got '4, 8'"."""
    rule = error["msg"]
    for pattern, word in _WORDS:
        rule = re.sub(pattern, word, rule, count=1)
    got = " ".join(repr(error["input"]).split())  # one line: the text of an array has several
    if isinstance(error["input"], dict) and len(got) > LONGEST:
        got = ""
    rule = f"{rule}, got {got}" if got else rule
    if error["type"] == "literal_error" and isinstance(error["input"], str):
        rule += find_nearest(error["input"], re.findall(r"'([^']*)'", error["ctx"]["expected"]))
    return rule


def suggest_instead(rule: str, value: Any) -> str:
    """What to write in a file instead of a value that breaks a rule; empty if this cannot be guessed."""
    if "a valid list" in rule and isinstance(value, dict):
        return "; begin each of its entries with a dash"
    if "a valid list" in rule and re.fullmatch(r"[\w.]+( *, *[\w.]+)*", str(value)) and value is not None:
        return f"; write [{value}]"
    if value is None:
        return (
            "; text that begins with # needs quotes" if "a valid string" in rule else "; remove a key that has no value"
        )
    if "a valid string" in rule and isinstance(value, int | float):
        return f"; in quotes it is text: '{value}'"
    if "a valid boolean" in rule and str(value).lower() in ("yes", "no", "on", "off", "y", "n", "1", "0"):
        return "; write true or false"
    if "a valid integer" in rule and isinstance(value, float) and value.is_integer():
        return f"; write {int(value)}"
    if isinstance(value, str) and ("a valid number" in rule or "a valid integer" in rule or "must be a list" in rule):
        return _suggest_number(value.strip())
    return ""


def _suggest_number(text: str) -> str:
    """What to write instead of text where a number is required."""
    parts = [part.strip() for part in text.strip("[]()").split(",")]
    if re.fullmatch(r"[-+]?\d+,\d+", text):
        return f"; a number has a point, {text.replace(',', '.')}, and a list brackets, [{', '.join(parts)}]"
    if len(parts) > 1 and all(re.fullmatch(_NUMBER, part) for part in parts):
        return f"; a list is written [{', '.join(parts)}]"
    if re.fullmatch(_NUMBER, text):
        return f"; without quotes it is a number: {text}"
    if re.fullmatch(r"[-+]?\d{1,3}([_']\d{3})+", text):
        return f"; write {re.sub('[^0-9+-]', '', text)}"
    if unit := re.fullmatch(rf"({_NUMBER})\s*(%|[a-zA-Z]+)", text):
        return f"; write a number alone: {float(unit[1]) / 100:g}" if unit[2] == "%" else f"; write {unit[1]} alone"
    return ""
