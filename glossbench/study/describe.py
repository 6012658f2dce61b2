"""A study in words: its sweeps, materials and claims, as `glossbench validate` prints them."""

from collections.abc import Sequence
from itertools import groupby
from operator import itemgetter
from typing import TYPE_CHECKING, Any

import numpy as np

from glossbench.columns import CONDITIONS
from glossbench.options import check, make_option_schema
from glossbench.study.claim_counts import count_claims
from glossbench.study.labels import as_text

if TYPE_CHECKING:
    from glossbench.study.expand import Axis, Form
    from glossbench.study.study import Study

MAX_VALUES = 8  # values that are listed of a sweep
MAX_LINES = 40  # lines that are printed for one heading


def count_in_words(n: int, what: str) -> str:
    """A number with its noun."""
    return f"{n:,} {what}{'' if n == 1 else 's'}"


def summarize_study(study: "Study") -> str:
    """The title of a study, and its numbers of lights, materials, views, cells and claims."""
    numbers = [count_in_words(np.unique(study.index.codes[kind][study.kept]).size, kind) for kind in CONDITIONS]
    numbers += [count_in_words(int(study.kept.sum()), "cell"), count_in_words(len(study.claims), "claim")]
    return f"{study.title}: {', '.join(numbers)}"


def describe_contents(study: "Study", forms: dict[str, list["Form"]]) -> dict[str, str]:
    """The contents of a study as text, by heading; several entries are several lines."""
    lines: dict[str, list[str]] = {kind: [describe_entry(form) for form in own] for kind, own in forms.items()}
    n_all, n_kept = len(study.kept), int(study.kept.sum())
    lines["metrics"] = [", ".join(study.metric_columns)]
    if study.exclude:
        lines["exclude"] = [f"{count_in_words(n_all - n_kept, 'cell')} of {n_all:,}"]
    lines["device"] = [
        study.device + ("" if study.has_device() else ": this machine has none, so `run` refuses the study")
    ]
    if study.plugins:
        lines["plug-ins"] = [", ".join(study.plugins)]
    lines["claims"] = []
    for claim, count in zip(study.claims, count_claims(study), strict=True):
        problem = f" (cannot be tested: {count.problem})" if count.problem else ""
        lines["claims"].append(f"{count_in_words(count.n, count.what)}: {claim.text}{problem}")
    return {word: "\n".join(_keep_first(own)) for word, own in lines.items()}


def describe_entry(form: "Form") -> str:
    """An item as the file states it: "ggx: alpha 0.1, 0.2 (isotropic); f0 0.04, 1 -> 4 materials"."""
    files = [axis for axis in form.axes if axis.options == ("file",)]
    name = str(files[0].values[0][0]) if form.cls.name == "file" and files else form.cls.name
    parts = [_describe_axis(form, axis) for axis in form.axes if axis not in files or form.cls.name != "file"]
    if form.tune:
        low, high = as_text(form.tune.low), as_text(form.tune.high)
        parts.append(f"{form.tune.option} tuned for the least {form.tune.metric} in [{low}, {high}]")
    text = f"{name}: {'; '.join(parts)}" if parts else name
    return text if form.count_variants() == 1 else f"{text} -> {count_in_words(form.count_variants(), form.noun)}"


def _describe_axis(form: "Form", axis: "Axis") -> str:
    if len(axis.options) > 1:
        together = [f"({', '.join(map(as_text, values))})" for values in axis.values]
        return f"{' and '.join(axis.options)} together {_join_texts(together)}"
    [option] = axis.options
    values = [check(form.cls, option, value) for (value,) in axis.values]
    if form.noun == "material" and len(make_option_schema(form.cls, option).get("prefixItems", [])) == 2:
        return f"{option} {_describe_widths(values)}"
    return f"{option} {_join_texts([as_text(value) for (value,) in axis.values])}"


def _describe_widths(values: Sequence[Any]) -> str:
    """Pairs of widths along t and b: two equal widths are an isotropic material, others an anisotropic one."""
    kinds = ["isotropic" if a == b else "anisotropic" for a, b in values]
    if kinds == ["anisotropic"]:
        return f"{as_text([*values[0]])} (one anisotropic material)"
    groups = []
    for kind, group in groupby(zip(kinds, values, strict=True), key=itemgetter(0)):
        texts = [as_text(a) if a == b else as_text([a, b]) for _, (a, b) in group]
        groups.append(f"{_join_texts(texts)} ({kind})")
    return ", ".join(groups)


def _join_texts(texts: Sequence[str]) -> str:
    more = f" and {len(texts) - MAX_VALUES:,} more" if len(texts) > MAX_VALUES else ""
    return ", ".join(texts[:MAX_VALUES]) + more


def _keep_first(lines: list[str]) -> list[str]:
    return [*lines[:MAX_LINES], *([f"... and {len(lines) - MAX_LINES:,} more"] if len(lines) > MAX_LINES else [])]
