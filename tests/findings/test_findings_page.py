"""The page of findings: what it says of a summary, and that the committed page is that of the committed summaries."""

from pathlib import Path

import pandas
import pytest

from glossbench.errors import InputError
from glossbench.findings.page import compose_page
from glossbench.findings.summary import Summary
from glossbench.study.study_files import find_study_files

DOCS = Path(__file__).parents[2] / "docs"


def case(value, low, high, verdict="holds"):
    return {"where": "spots", "value": value, "low": low, "high": high, "verdict": verdict}


def claim(text="A is better", verdict="holds", numbers=(), quantity="rms of a over b"):
    return {
        "text": text,
        "verdict": verdict,
        "numbers": list(numbers),
        "quantity": quantity,
        "summary": "Not tested: x.",
    }


def summary(name="one", claims=(), file="/home/someone/probe.hdr"):
    study = {
        "title": "Title",
        "question": "Why?",
        "source": "Someone 2001",
        "light": [{"file": {"file": file}}],
    }
    made = {
        "glossbench": "0.1.0",
        "torch": "2.13",
        "processor": "A",
        "cores": 2,
        "finished": "2026-11-28T09:00:00+00:00",
    }
    traceback = 'Traceback (most recent call last):\n  File "/home/someone/m.py"\nValueError: no'
    cells = {"status": ["done", "failed"], "rms": [0.1, float("nan")], "reason": ["", traceback]}
    cells["light_options"] = [f'{{"file": "{file}"}}'] * 2
    return Summary(
        name, study, list(claims), {**made, "command": "glossbench run /home/someone"}, pandas.DataFrame(cells)
    )


def test_a_claim_shows_its_verdict_its_cases_and_its_extreme_numbers_with_their_intervals():
    cases = [case(0.5, 0.45, 0.55), case(0.25, 0.2, 0.3), case(0.75, 0.7, 0.8, "within noise")]

    page = compose_page([summary(claims=[claim(numbers=cases)])])

    assert (
        "| A is better | holds | 2 of 3 hold, 1 within noise | rms of a over b: 0.25 [0.2, 0.3] to 0.75 [0.7, 0.8] |"
        in page
    )


def test_a_number_without_noise_shows_no_interval():
    page = compose_page([summary(claims=[claim(numbers=[case(17, 17, 17)])])])

    assert "| rms of a over b: 17 |" in page


def test_numbers_that_are_not_finite_are_counted_and_an_unknown_interval_is_marked():
    cases = [case(None, None, None), case(0.5, None, None)]

    page = compose_page([summary(claims=[claim(numbers=cases), claim(numbers=cases[:1])])])

    assert "| rms of a over b: 0.5 [?, ?]; not finite in 1 of 2 cases |" in page
    assert "| rms of a over b: infinite |" in page


def test_a_claim_without_a_case_says_why():
    assert "| none | Not tested: x. |" in compose_page([summary(claims=[claim(verdict="not tested")])])


def test_a_section_says_when_by_which_version_and_on_which_machine():
    assert "2 cells (1 failed), 2026-11-28, glossbench 0.1.0, torch 2.13, A, 2 cores." in compose_page([summary()])


def test_studies_without_a_summary_are_listed():
    page = compose_page([summary("one")], ["one", "two"])

    assert page.endswith("## Studies without a summary\n\n- `two`\n")


def test_remarks_come_last():
    page = compose_page([summary("one")], ["two"], "## Remarks\n\nA remark.\n")

    assert page.endswith("- `two`\n\n## Remarks\n\nA remark.\n")


def test_a_summary_is_read_as_it_was_written(tmp_path):
    made = summary(claims=[claim(numbers=[case(0.5, 0.4, 0.6)])])

    made.write(tmp_path / "one")

    assert compose_page([Summary.read(tmp_path / "one")]) == compose_page([made])


def test_a_summary_names_no_folder_of_this_machine(tmp_path):
    summary().write(tmp_path)

    assert not [path.name for path in tmp_path.iterdir() if b"someone" in path.read_bytes()]
    assert Summary.read(tmp_path).cells["reason"][1] == "ValueError: no"


def test_a_folder_that_lacks_a_file_is_named(tmp_path):
    summary().write(tmp_path)
    (tmp_path / "claims.json").unlink()

    with pytest.raises(InputError, match=r"holds no summary: claims\.json is missing"):
        Summary.read(tmp_path)


def committed():
    """The page that the committed summaries give."""
    kept = DOCS / "findings"
    summaries = [Summary.read(path.parent) for path in sorted(kept.glob("*/claims.json"))]
    return compose_page(summaries, find_study_files(), (kept / "remarks.md").read_text(encoding="utf-8"))


def test_the_committed_page_is_that_of_the_committed_summaries():
    assert (DOCS / "findings.md").read_text(encoding="utf-8") == committed()


def test_every_installed_study_is_on_the_page():
    page = (DOCS / "findings.md").read_text(encoding="utf-8")

    assert [name for name in find_study_files() if f"## {name}\n" not in page and f"- `{name}`" not in page] == []
