"""The extent of a claim that does not hold everywhere: what the cases share in which it does."""

from collections.abc import Mapping, Sequence
from functools import reduce
from itertools import combinations
from operator import and_
from typing import Any

from glossbench.findings.comparisons import FAILS, HOLDS
from glossbench.findings.where_words import make_shortener, split_where

FEWEST = 3  # cases of a group
LARGEST = 4  # groups that are named
PAIR = 0.1  # share of all cases that a group of two words has at least

Groups = Mapping[tuple[str, ...], int]  # members of each group as the bits of a number, by the words that they share


def describe_extent(cases: Sequence[Mapping[str, Any]]) -> str:
    """Where a claim fails or holds, if one or two words of its cases tell it; else "".

    "It fails only for W (k of n cases)", if all cases that fail share a word; else "it holds for W (n cases)" for the
    largest groups of cases that share a word, or two, in which no case fails and one holds. Such a group has three
    cases at least, and not all. The words are found after the fact: a small group may be whole by chance.

    Args:
        cases: as JSON types, with `where` and `verdict`.
    """
    holds, fails = (sum(1 << i for i, case in enumerate(cases) if case["verdict"] == each) for each in (HOLDS, FAILS))
    if not holds or not fails or len(cases) <= FEWEST:
        return ""
    words = [split_where(str(case["where"])) for case in cases]
    shorten = make_shortener(words)
    found: dict[str, int] = {}
    place: dict[str, int] = {}
    for i, own in enumerate(words):
        for at, word in enumerate(map(shorten, own)):
            found[word] = found.get(word, 0) | 1 << i
            place.setdefault(word, at)
    in_order = sorted(found, key=lambda word: place[word])
    groups: Groups = {(word,): found[word] for word in in_order if found[word].bit_count() < len(cases)}
    if only := [name for name, members in groups.items() if not fails & ~members]:
        shared = reduce(and_, (groups[name] for name in only))
        first, *others = (name[0] for name in only)
        named = f"{first} with {' and '.join(others)}" if others else first
        counted = f"{fails.bit_count()} of {shared.bit_count()} cases" if shared.bit_count() > 1 else "one case"
        return f"It fails only for {named} ({counted})"
    whole = _find_whole(groups, holds, fails, FEWEST)
    if not whole:
        pairs: Groups = {(*a, *b): groups[a] & groups[b] for a, b in combinations(groups, 2)}
        whole = _find_whole(pairs, holds, fails, max(FEWEST, PAIR * len(cases)))
    told = [f"{' with '.join(name)} ({members.bit_count()} cases)" for name, members in whole[:LARGEST]]
    others = [f"{len(whole) - LARGEST} smaller groups"] if len(whole) > LARGEST else []
    return f"It holds for {', '.join([*told, *others])}" if told else ""


def _find_whole(groups: Groups, holds: int, fails: int, fewest: float) -> list[tuple[tuple[str, ...], int]]:
    """Groups in which no case fails and one holds, the largest first, without those that lie within a larger one."""
    whole = [
        each for each in groups.items() if each[1].bit_count() >= fewest and each[1] & holds and not each[1] & fails
    ]
    whole.sort(key=lambda each: -each[1].bit_count())
    return [each for i, each in enumerate(whole) if all(each[1] & ~larger for _, larger in whole[:i])]
