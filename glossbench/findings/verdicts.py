"""Verdicts: whether the cells of a study confirm its claims."""

import json
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Sequence
from itertools import compress
from typing import Any

import numpy as np
import pandas

from glossbench.columns import CONDITIONS, is_cost, parse_row, with_parts
from glossbench.findings.comparisons import (
    Case,
    Row,
    Side,
    judge_lower,
    judge_ratio,
    judge_slope,
    judge_value,
    keep_finite,
)
from glossbench.findings.conclusions import conclude, describe_readings
from glossbench.findings.estimates import Sample
from glossbench.study.cell_index import CellIndex
from glossbench.study.claim_names import find_meanings
from glossbench.study.claims import (
    BUDGET,
    SEED,
    Claim,
    LowerClaim,
    RatioClaim,
    SlopeClaim,
    ValueClaim,
    find_pairing,
    get_method,
    get_options,
    get_places,
    list_methods,
    list_sides,
)
from glossbench.study.claims import Side as Stated
from glossbench.study.labels import (
    as_text,
    find_differing,
    format_options,
    identify,
    name_items,
    read_number,
    read_stated,
    with_options,
)


def judge(claims: Sequence[Claim], cells: pandas.DataFrame) -> list[dict[str, Any]]:
    """The verdict on each claim, with its numbers, as JSON types.

    A case holds or does not hold. It is within noise if its 95 % interval contains the bound, and a case of "lower" is
    equal if its two sides differ by less than the margin. Cells that differ only in the seed of their random points are
    one case, of their mean. A claim does not hold if one case does not; else it holds if one case holds; else it is
    equal if one case is equal; else it is within noise. A claim without a case is not tested, and the summary says why.
    A claim with readings has a verdict for each reading, too.
    """
    table = _Table(cells.to_dict("records"))
    return [table.judge(claim) for claim in claims]


def find_cells(claim: Claim, cells: pandas.DataFrame) -> set[str]:
    """Keys of the cells that a claim is about, on all its sides."""
    table = _Table(cells.to_dict("records"))
    return {row["key"] for side in list_sides(claim).values() for row in table.pick(claim, side, Counter())}


class _Table:
    """The rows of a run, ready to be picked for a claim."""

    def __init__(self, records: list[Any]) -> None:
        self.rows: list[Row] = [with_parts(parse_row(record)) for record in records]
        for row in self.rows:
            row["options"] = read_stated(row)  # a claim cannot ask for the value that tuning found
        self._index = CellIndex.from_rows(self.rows)
        self._options: dict[str, set[str]] = {}
        for row in self.rows:
            self._options.setdefault(row["method"], set()).update(row["options"])
        self._names = {place: name_items(place, self.rows) for place in CONDITIONS}

    def judge(self, claim: Claim) -> dict[str, Any]:
        notes: Counter[str] = Counter()
        sides = [_spell_side(side) for side in list_sides(claim).values()]
        picked = [self.pick(claim, side, notes) for side in list_sides(claim).values()]
        cases: list[Case] = []
        match claim:
            case LowerClaim():
                quantity = f"{claim.metric} of {sides[0]} over {sides[1]}"
                for a, b, where, reading in self._pair_cells(claim, picked, notes):
                    cases.append(judge_lower(claim, a, b, where)._replace(reading=reading))
            case RatioClaim():
                quantity = f"{claim.of} of {sides[0]} over {sides[1]}"
                for a, b, where, reading in self._pair_cells(claim, picked, notes):
                    if b.value == 0:
                        notes[f"pairs whose divisor, {claim.of} of {sides[1]}, is zero"] += 1
                    else:
                        cases.append(judge_ratio(claim, a, b, where)._replace(reading=reading))
            case SlopeClaim():
                quantity = f"slope of log {claim.metric} over log {claim.over}"
                cases += self._judge_slopes(claim, picked[0], notes)
            case ValueClaim():
                quantity = f"{claim.of} of {sides[0]}"
                rows = _merge_seeds(picked[0])
                varying = find_differing([row["options"] for row in rows])
                for row in rows:
                    where = _join_parts([self._describe_place(row), _format_row(row, varying)])
                    cases.append(judge_value(claim, row["side"], where)._replace(reading=_format_reading(claim, row)))
        verdict, summary = conclude(cases, quantity, notes, sides)
        judgement = {"text": claim.text, "kind": claim.kind, "verdict": verdict, "quantity": quantity}
        told = {"readings": describe_readings(cases), "summary": summary}
        return {**judgement, "numbers": [case.as_numbers() for case in cases], **told}

    def pick(self, claim: Claim, side: Stated, notes: Counter[str]) -> list[Row]:
        """The finished cells of a side that a claim is about, in which the column of the claim is a finite number."""
        column = claim.metric if isinstance(claim, LowerClaim | SlopeClaim) else claim.of
        about = list_methods(claim)
        of_methods = set().union(*(self._options.get(name, set()) for name in about))
        fits = self._index.is_called("method", get_method(side)) & self._index.find_within(claim.where, of_methods)
        fits &= self._index.find_within(get_places(side) | get_options(side), of_methods)
        picked = []
        for row in compress(self.rows, fits):
            if row["status"] != "done":
                notes[f"cells {row['status']}"] += 1
                continue
            value = keep_finite(row.get(column))
            if value is None:
                notes[f"cells without a finite {column}"] += 1
            else:
                picked.append({**row, column: value, "side": _make_side(row, column, value)})
                notes["cells without a measured noise"] += not is_cost(column) and column not in row["left_out"]
        return picked

    def _pair_cells(
        self, claim: LowerClaim | RatioClaim, picked: list[list[Row]], notes: Counter[str]
    ) -> Iterator[tuple[Side, Side, str, tuple[str, ...]]]:
        """Pairs of cells, one from each side, with equal light, material and view and equal pairing options.

        With each pair, what is compared, and under which reading of the claim.

        A light, material or view that a side states need not be equal.
        """
        shared = set.intersection(*({key for row in rows for key in row["options"]} for rows in picked))
        budgets = {row["budget"] for rows in picked for row in rows}
        keys, places = find_pairing(claim, shared, budgets)
        first, second = ([*rows] if SEED in keys else _merge_seeds(rows) for rows in picked)
        varying = [find_differing([row["options"] for row in rows]) for rows in (first, second)]
        stated = [place for place in CONDITIONS if place not in places]
        partners: dict[str, list[Row]] = {}
        for b in second:
            partners.setdefault(_make_key(b, keys, places), []).append(b)
        for a in first:
            found = partners.get(_make_key(a, keys, places), [])
            notes["cells without a counterpart"] += not found
            for b in found:
                sides = zip((a, b), varying, strict=True)
                told = [_format_row(row, [key for key in own if key not in keys]) for row, own in sides]
                told = [
                    _join_parts([self._describe_place(row, stated), text])
                    for row, text in zip((a, b), told, strict=True)
                ]
                if a.get("n_samples") != b.get("n_samples"):  # a pattern may have fewer or more samples than the budget
                    told = [
                        f"{text} with {row['n_samples']} samples" if text else f"{row['n_samples']} samples"
                        for text, row in zip(told, (a, b), strict=True)
                    ]
                sides_told = [text or row["method"] for text, row in zip(told, (a, b), strict=True)]
                against = " against ".join(sides_told) if any(told) else ""
                yield (
                    a["side"],
                    b["side"],
                    _join_parts([self._describe_place(a, places), _format_row(a, keys), against]),
                    _format_reading(claim, a, b),
                )

    def _judge_slopes(self, claim: SlopeClaim, rows: list[Row], notes: Counter[str]) -> Iterator[Case]:
        held = {"method": {key for row in rows for key in row["options"]}}
        held |= {place: {key for row in rows for key in row[f"{place}_options"]} for place in CONDITIONS}
        of, option = next(iter(find_meanings(claim.over, held)), ("method", claim.over))
        without = {place: option if place == of else "" for place in CONDITIONS}
        names = {place: name_items(place, self.rows, without[place]) for place in CONDITIONS}
        places: dict[str, list[Row]] = {}
        for row in rows:
            budget = read_number(row["options" if of == "method" else f"{of}_options"].get(option))
            if (row.get("at_noise_floor") and not is_cost(claim.metric)) or row[claim.metric] == 0:
                notes["cells at the noise floor"] += 1
            elif budget is None or budget <= 0:
                notes[f"cells without a positive {claim.over}"] += 1
            else:
                place = [identify(place, row, without[place]) for place in CONDITIONS]
                places.setdefault(json.dumps(place), []).append({**row, "over": budget})
        for members in places.values():
            for group, own in _group_curves(members if option == SEED else _merge_seeds(members)):
                x = [row["over"] for row in group]
                if len(set(x)) < 3:
                    notes["curves of fewer than 3 points"] += 1
                    continue
                called = [names[place][identify(place, group[0], without[place])] for place in CONDITIONS]
                case = judge_slope(claim, x, [row["side"] for row in group], _join_parts([*called, own]))
                yield case._replace(reading=_format_reading(claim, group[0]))

    def _describe_place(self, row: Row, places: Collection[str] = CONDITIONS) -> str:
        return _join_parts([self._names[place][identify(place, row)] for place in CONDITIONS if place in places])


def _spell_side(side: Stated) -> str:
    return with_options(get_method(side), get_options(side) | get_places(side))


def _join_parts(parts: list[str]) -> str:
    return ", ".join(part for part in parts if part)


def _format_row(row: Row, keys: Collection[str]) -> str:
    return format_options({key: row["options"][key] for key in keys if key in row["options"]})


def _format_reading(claim: Claim, *rows: Row) -> tuple[str, ...]:
    """The values of the claim's options `by`, each of the first cell that has it."""
    held = {key: value for row in reversed(rows) for key, value in row["options"].items()}
    return tuple(format_options({key: held.get(key)}) for key in claim.by)


def _make_key(row: Row, options: Collection[str], places: Collection[str] = CONDITIONS) -> str:
    """The light, material and view of a cell, and some options of its method, as text."""
    about = [(row[place], row[f"{place}_options"]) for place in places]
    values = [row["options"].get(row["budget"] if key == BUDGET else key) for key in options]
    return json.dumps([about, values], sort_keys=True)


def _make_side(row: Row, column: str, value: float) -> Side:
    """One cell as a side of a comparison."""
    seed = row["options"].get(SEED) if row.get("is_random") else None
    return Side(value, [Sample(row["left_out"].get(column) or [value], str(row.get("reference_key")), seed)])


def _merge_seeds(rows: Iterable[Row]) -> list[Row]:
    """The rows, with those that differ only in the seed of their random points merged into one row with one side."""
    alike: dict[str, list[Row]] = {}
    for row in rows:
        options = {key: value for key, value in row["options"].items() if key != SEED or not row.get("is_random")}
        alike.setdefault(_make_key({**row, "options": options}, sorted(options)), []).append(row)
    found = []
    for same in alike.values():
        if len(same) > 1:
            samples = [sample for row in same for sample in row["side"].samples]
            options = {key: value for key, value in same[0]["options"].items() if key != SEED}
            side = Side(float(np.mean([row["side"].value for row in same])), samples)
            same = [{**same[0], "options": options, "side": side}]
        found += same
    return found


def _group_curves(rows: list[Row]) -> list[tuple[list[Row], str]]:
    """The rows of one light, material and view as curves, with one point for each value of the claim's `over`.

    If several rows share a value, the option with the fewest values among them splits the rows into several curves.
    """
    points: dict[float, list[Row]] = {}
    for row in rows:
        points.setdefault(row["over"], []).append(row)
    telling = {key for same in points.values() for key in find_differing([row["options"] for row in same])}
    if not telling:
        return [(rows, "")]
    groups = {key: {json.dumps(row["options"].get(key)): row for row in rows} for key in telling}
    key = min(sorted(telling), key=lambda k: len(groups[k]))
    curves = []
    for value in groups[key]:
        part = [row for row in rows if json.dumps(row["options"].get(key)) == value]
        curves += [
            (group, _join_parts([f"{key} {as_text(json.loads(value))}", own])) for group, own in _group_curves(part)
        ]
    return curves
