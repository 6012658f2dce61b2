"""How many cells, or pairs of cells, each claim of a study is about: known before the study runs."""

import json
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from glossbench.columns import CONDITIONS
from glossbench.shading.method import METHODS
from glossbench.study.cell_index import CellIndex, Mask
from glossbench.study.checked_claims import places_in
from glossbench.study.claim_names import meanings
from glossbench.study.claims import (
    BUDGET,
    SEED,
    Claim,
    LowerClaim,
    RatioClaim,
    SlopeClaim,
    method_of,
    methods_of,
    options_of,
    pairing,
    places_of,
    sides_of,
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


def counts(study: "Study") -> list[Count]:
    """The count of each claim, in the order of the claims."""
    index, kept = study.index, study.kept
    options: dict[str, set[str]] = {}
    for item in study.methods:
        options.setdefault(item.name, set()).update(item.as_dict())
    twins = _twins(study)
    parameters = {place: {key for item in items for key in item.as_dict()} for place, items in places_in(study).items()}
    return [_count(claim, index, kept, options, parameters, twins) for claim in study.claims]


def _count(
    claim: Claim, index: CellIndex, kept: Mask, options: dict[str, set[str]], parameters: dict[str, set[str]],
    twins: NDArray[np.intp],
) -> Count:  # fmt: skip
    of_methods = set().union(*(options[name] for name in methods_of(claim)))
    within = kept & index.within(claim.where, of_methods)
    sides = []
    for side in sides_of(claim).values():
        asked = index.within(places_of(side) | options_of(side), of_methods)
        sides.append(np.flatnonzero(within & asked & index.is_called("method", method_of(side))))
    match claim:
        case LowerClaim() | RatioClaim():
            shared = set.intersection(*(options[method_of(side)] for side in sides_of(claim).values()))
            budgets = {name: budget[0] if (budget := METHODS.get(name).contract.budget) else "" for name in options}
            keys, places = pairing(claim, shared, {budgets[method_of(side)] for side in sides_of(claim).values()})
            if SEED not in keys:  # several seeds are one case
                sides = [side[np.unique(twins[side], return_index=True)[1]] for side in sides]
            alike = index.alike(places, keys, budgets)
            (first, n_first), (second, n_second) = (np.unique(alike[side], return_counts=True) for side in sides)
            _, i, j = np.intersect1d(first, second, assume_unique=True, return_indices=True)
            n = int((n_first[i] * n_second[j]).sum())
            equal = ", ".join([*places, *("budget" if key == BUDGET else key for key in keys)])
            return Count(n, "pair", "" if n else f"no cell of one side has a counterpart with the same {equal}")
        case SlopeClaim():
            [(of, option), *_] = meanings(claim.over, {"method": options[method_of(claim.slope)], **parameters})
            over = option if of == "method" else f"{of}.{option}"
            n_values = len(np.unique(index.alike((), [over])[sides[0]]))
            few = f"a slope needs 3 values of {claim.over}, and has {n_values}"
            return Count(len(sides[0]), "cell", few if n_values < 3 else "")
        case _:
            return Count(len(sides[0]), "cell")


def _twins(study: "Study") -> NDArray[np.intp]:
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
