"""The words that say where a case of a claim was compared: its light, material, view, options, and sides."""

from collections.abc import Callable, Sequence


def split_where(where: str) -> list[str]:
    """What stands between commas outside of all brackets."""
    parts: list[str] = []
    for piece in where.split(", "):
        if parts and sum(map(parts[-1].count, "([")) > sum(map(parts[-1].count, ")]")):
            parts[-1] += f", {piece}"
        else:
            parts.append(piece)
    return parts


def make_shortener(words: Sequence[Sequence[str]]) -> Callable[[str], str]:
    """What shortens a word of such cases: of a name that all cases share, only the options are left.

    Of "kurt (m 0.1)" and "kurt (m 0.2)" these are "m 0.1" and "m 0.2".
    """
    heads = set.intersection(*({word.partition(" (")[0] for word in own if word.endswith(")")} for own in words))

    def shorten(word: str) -> str:
        name, _, options = word.partition(" (")
        if not word.endswith(")") or " against " in word:
            return word
        return options[:-1] if name in heads else f"{name} with {options[:-1]}"

    return shorten
