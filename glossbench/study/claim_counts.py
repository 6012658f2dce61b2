"""How many cells, or pairs of cells, each claim of a study is about: known before the study runs."""

import json
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from glossbench.columns import CONDITIONS
from glossbench.shading.method import METHODS
from glossbench.study.cell_index import CellIndex, Mask
from glossbench.study.claim_checks import collect_places
from glossbench.study.claim_names import find_meanings
from glossbench.study.claims import (
    BUDGET,
    SEED,
    Claim,
    LowerClaim,
    RatioClaim,
    SlopeClaim,
    find_pairing,
    get_method,
    get_options,
    get_places,
    list_methods,
    list_sides,
)

if TYPE_CHECKING:
    from glossbench.study.study import Study


class Count(NamedTuple):
    """How many cells or pairs a claim is about.

    Attributes:
        n: their number.
        what: "cell" or "pair".
        problem: why these are too few for a verdict; empty if they are enough.
    """

    n: int
    what: str
    problem: str = ""


def count_claims(study: "Study") -> list[Count]:
    """The count of each claim, in the order of the claims."""
    index, kept = study.index, study.kept
    options: dict[str, set[str]] = {}
    for item in study.methods:
        options.setdefault(item.name, set()).update(item.as_dict())
    twins = _number_twins(study)
    parameters = {
        place: {key for item in items for key in item.as_dict()} for place, items in collect_places(study).items()
    }
    return [_count(claim, index, kept, options, parameters, twins) for claim in study.claims]


def _count(
    claim: Claim, index: CellIndex, kept: Mask, options: dict[str, set[str]], parameters: dict[str, set[str]],
    twins: NDArray[np.intp],
) -> Count:  # fmt: skip
    of_methods = set().union(*(options[name] for name in list_methods(claim)))
    within = kept & index.find_within(claim.where, of_methods)
    sides = []
    for side in list_sides(claim).values():
        asked = index.find_within(get_places(side) | get_options(side), of_methods)
        sides.append(np.flatnonzero(within & asked & index.is_called("method", get_method(side))))
    match claim:
        case LowerClaim() | RatioClaim():
            shared = set.intersection(*(options[get_method(side)] for side in list_sides(claim).values()))
            budgets = {name: budget[0] if (budget := METHODS.get(name).contract.budget) else "" for name in options}
            keys, places = find_pairing(
                claim, shared, {budgets[get_method(side)] for side in list_sides(claim).values()}
            )
            if SEED not in keys:  # several seeds are one case
                sides = [side[np.unique(twins[side], return_index=True)[1]] for side in sides]
            alike = index.group_cells(places, keys, budgets)
            (first, n_first), (second, n_second) = (np.unique(alike[side], return_counts=True) for side in sides)
            _, i, j = np.intersect1d(first, second, assume_unique=True, return_indices=True)
            n = int((n_first[i] * n_second[j]).sum())
            equal = ", ".join([*places, *("budget" if key == BUDGET else key for key in keys)])
            return Count(n, "pair", "" if n else f"no cell of one side has a counterpart with the same {equal}")
        case SlopeClaim():
            [(of, option), *_] = find_meanings(claim.over, {"method": options[get_method(claim.slope)], **parameters})
            over = option if of == "method" else f"{of}.{option}"
            n_values = len(np.unique(index.group_cells((), [over])[sides[0]]))
            few = f"a slope needs 3 values of {claim.over}, and has {n_values}"
            return Count(len(sides[0]), "cell", few if n_values < 3 else "")
        case _:
            return Count(len(sides[0]), "cell")


def _number_twins(study: "Study") -> NDArray[np.intp]:
    """A number for each cell. Cells that differ only in the seed of their random points have the same number."""
    known: dict[str, int] = {}
    methods = []
    for item in study.methods:
        options = item.as_dict()
        if SEED in options and item.method.is_random:
            del options[SEED]
        methods.append(known.setdefault(json.dumps([item.name, options], sort_keys=True), len(known)))
    codes = [
        *(study.index.codes[place] for place in CONDITIONS),
        np.array(methods, np.intp)[study.index.codes["method"]],
    ]
    return np.ravel_multi_index(codes, [int(each.max()) + 1 for each in codes])
