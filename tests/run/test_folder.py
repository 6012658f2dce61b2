"""Folders of results: what is damaged is made again, what is not ours stays, and no link leads out."""

import json
import os
import shutil
from pathlib import Path

import pytest

from glossbench.atomic import replacing
from glossbench.errors import InputError, WriteError
from glossbench.run.manifest import KEPT, SUMMARY
from glossbench.run.results import AGAIN, Results
from glossbench.run.runner import Progress, run_study
from glossbench.strict_json import restore_numbers, seal, unseal
from oracles.flat_studies import Flat, interrupting, registered, remains, study_in

STUDY = {
    "methods": "[{flat: {samples: [1, 2]}}, {regular_sampling: {samples: 4}}]",
    "claims": "[{text: A, lower: flat, than: regular_sampling, metric: rms}]",
    "metrics": "[rms, flip]",
}


@pytest.fixture(autouse=True)
def names():
    with registered():
        yield


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A study, the folder of its results, and what remains of them."""
    folder = tmp_path_factory.mktemp("made")
    with registered():
        study = study_in(folder, **STUDY)
        return study, run_study(study, folder / "r").folder, remains(folder / "r")


@pytest.fixture
def folder(made, tmp_path):
    """These results, in a folder of one's own."""
    return shutil.copytree(made[1], tmp_path / "r")


def everything(folder: Path) -> dict[str, bytes]:
    return {str(path): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def said_by(study, folder: Path) -> list[str]:
    said: list[str] = []
    run_study(study, folder, progress=Progress(note=said.append))
    return said


def only(folder: Path, pattern: str) -> Path:
    return sorted(folder.glob(pattern))[0]


def emptied(path: Path) -> None:
    path.write_bytes(b"")


def halved(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def flipped(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


# Damage

DAMAGE = [emptied, halved, flipped, Path.unlink]
OF_CELLS = ["images/*[0-9a-f].exr", "images/*_half_vectors.npy"]
OF_REFERENCES = [
    "references/*[0-9a-f].exr",
    "references/*_standard_error.exr",
    "references/*_deviates.npz",
    "references/*_mask.png",
]


@pytest.mark.parametrize(
    ("pattern", "harm"), [*((OF_CELLS[0], harm) for harm in DAMAGE), (OF_CELLS[1], emptied), (OF_CELLS[1], Path.unlink)]
)
def test_a_damaged_file_of_a_cell_is_made_again(made, folder, pattern, harm):
    study, _, expected = made
    path = only(folder, pattern)
    harm(path)

    said = said_by(study, folder)

    state = "missing" if harm is Path.unlink else "damaged"
    assert said == [f"{path} is {state}: this cell is computed again"]
    assert remains(folder) == expected


@pytest.mark.parametrize("pattern", OF_REFERENCES)
def test_a_damaged_file_of_a_reference_is_made_again_and_its_cells_stay(made, folder, pattern, monkeypatch):
    study, _, expected = made
    path = only(folder, pattern)
    halved(path)
    monkeypatch.setattr("glossbench.run.executor.measure", None)

    said = said_by(study, folder)

    assert said == [f"{path} is damaged: this reference is computed again"]
    assert remains(folder) == expected


@pytest.mark.parametrize(
    ("pattern", "harm"),
    [("cells/*.json", emptied), ("cells/*.json", halved), ("cells/*.json", flipped), ("references/*.json", flipped)],
)
def test_damaged_numbers_are_made_again(made, folder, pattern, harm):
    study, _, expected = made
    harm(only(folder, pattern))

    assert len(said_by(study, folder)) == 1
    assert remains(folder) == expected


@pytest.mark.parametrize("name", [*SUMMARY, *KEPT, "glossbench.json"])
@pytest.mark.parametrize("harm", [halved, Path.unlink])
def test_a_damaged_summary_is_read_from_the_cells_and_written_again(made, folder, name, harm):
    study, _, expected = made
    whole = Results(folder)
    cells, claims = whole.cells, whole.claims
    harm(folder / name)

    if name not in ("study.yaml", "glossbench.json"):
        again = Results.open(folder) if harm is not Path.unlink or name != "glossbench.json" else Results(folder)
        assert again.cells.equals(cells)
        assert again.claims == claims
        assert [line.endswith(AGAIN) for line in again.remarks(cells)] == [True]
    assert said_by(study, folder) == []
    assert remains(folder) == expected
    assert Results.open(folder).remarks(cells) == []


def test_results_keep_the_columns_and_descriptions_of_their_run(folder, monkeypatch):
    expected = Results(folder).columns, Results(folder).descriptions
    monkeypatch.setattr("glossbench.metrics.pixelwise.RMS.unit", "candela")
    monkeypatch.setattr("glossbench.metrics.pixelwise.RMS.__doc__", "Another text.")

    found = Results(folder)

    assert (found.columns, found.descriptions) == expected
    assert (found.columns["rms"].unit, found.descriptions.is_of_run) == ("radiance", True)


@pytest.mark.parametrize("harm", [halved, Path.unlink])
def test_results_without_their_columns_and_descriptions_have_those_of_what_is_installed(folder, monkeypatch, harm):
    """Twin of the above."""
    for name in KEPT:
        harm(folder / name)
    monkeypatch.setattr("glossbench.metrics.pixelwise.RMS.unit", "candela")

    found = Results(folder)

    assert (found.columns["rms"].unit, found.descriptions.is_of_run) == ("candela", False)


def test_whole_results_are_not_made_again(made, folder):
    """Twin of the above."""
    study, _, expected = made

    assert said_by(study, folder) == []
    assert Results(folder).remarks(Results(folder).cells) == []
    assert remains(folder) == expected


@pytest.mark.parametrize("pattern", [OF_CELLS[0], OF_REFERENCES[0]])
def test_a_cell_without_whole_files_has_failed_and_says_what_to_do(folder, pattern):
    path = only(folder, pattern)
    flipped(path)

    results = Results.open(folder)

    n = 1 if pattern in OF_CELLS else 3
    failed = results.cells[results.cells["status"] == "failed"]
    assert list(failed["reason"]) == [f"{path} is damaged{AGAIN}"] * n
    assert len(results.remarks(results.cells)) == 1


# A full disk


def full(monkeypatch, ending: str) -> None:
    """The disk is full when the first file with this ending is written."""

    class Full:
        def __init__(self, path: Path, lasts: bool) -> None:
            self.path, self.context = path, replacing(path, lasts)

        def __enter__(self) -> Path:
            if self.path.name.endswith(ending):
                raise WriteError(self.path, "No space left on device")
            return self.context.__enter__()

        def __exit__(self, *error: object) -> object:
            return self.context.__exit__(*error)

    monkeypatch.setattr("glossbench.run.folder.replacing", Full)


@pytest.mark.parametrize(
    "ending", ["_standard_error.exr", "_deviates.npz", "_mask.png", "_half_vectors.npy", "cells.parquet"]
)
def test_a_full_disk_stops_the_run_fails_no_cell_and_the_run_continues_later(made, tmp_path, ending):
    study, _, expected = made
    with pytest.MonkeyPatch.context() as patch:
        full(patch, ending)
        with pytest.raises(WriteError, match=r"cannot be written: No space left on device$"):
            run_study(study, tmp_path / "r")
    states = [json.loads(path.read_text())["status"] for path in (tmp_path / "r" / "cells").iterdir()]

    run_study(study, tmp_path / "r")

    assert "failed" not in states
    assert remains(tmp_path / "r") == expected


def test_a_limit_on_the_size_of_files_is_one_line(tmp_path):
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (16384, before[1]))
    try:
        with pytest.raises(WriteError, match=r"r/references/\S+: cannot be written: .*[Ff]ile too large"):
            run_study(study_in(tmp_path, view="{sphere: {resolution: 64}}"), tmp_path / "r")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)

    assert list((tmp_path / "r").rglob(".*")) == []
    assert list((tmp_path / "r" / "cells").iterdir()) == []


def test_a_method_that_cannot_write_elsewhere_fails_its_cell_alone(tmp_path, monkeypatch):
    """Twin of the above."""

    def shade(*arguments: object) -> None:
        raise WriteError(tmp_path / "elsewhere", "No space left on device")

    monkeypatch.setattr(Flat, "shade", shade)

    assert set(run_study(study_in(tmp_path), tmp_path / "r").cells["status"]) == {"failed"}


def read_all(results: Results) -> None:
    for row in results.cells.to_dict("records"):
        results.image(row["key"])
        results.reference(row["reference_key"])


# What is not ours


@pytest.mark.parametrize("name", ["study.yaml", "cells.parquet", "provenance.json", "claims.json"])
def test_a_foreign_file_stops_the_run_before_it_writes(made, tmp_path, name):
    home = tmp_path / "home"
    home.mkdir()
    (home / name).write_text("precious")

    with pytest.raises(InputError, match=rf"home/{name} was not written by glossbench, and would be lost: "):
        run_study(made[0], home)

    assert everything(home) == {str(home / name): b"precious"}


def test_a_study_is_not_written_over_by_its_own_results(made, tmp_path):
    study = study_in(tmp_path, **STUDY)
    (tmp_path / "s.yaml").rename(tmp_path / "study.yaml")
    before = everything(tmp_path)

    with pytest.raises(InputError, match=r"study\.yaml (was not written by|is the study itself)"):
        run_study(study, tmp_path)

    assert everything(tmp_path) == before


def test_the_study_of_results_runs_again_where_it_is_unless_it_was_changed(made, folder):
    from glossbench.study.study import load_study

    assert said_by(load_study(folder / "study.yaml"), folder) == []
    changed = (folder / "study.yaml").read_text() + "# mine\n"
    (folder / "study.yaml").write_text(changed)

    with pytest.raises(InputError, match=r"study\.yaml is the study itself"):
        run_study(load_study(folder / "study.yaml"), folder)

    assert (folder / "study.yaml").read_text() == changed


@pytest.mark.parametrize("name", ["cells", "images", "references", "glossbench.json"])
def test_a_link_out_of_the_folder_is_not_followed(made, folder, tmp_path, name):
    mine = tmp_path / "mine"
    shutil.move(folder / name, mine)
    (folder / name).symlink_to(mine)
    before = everything(tmp_path)

    with pytest.raises(InputError, match=rf"r/{name}.* leads out of the folder of results, to "):
        run_study(made[0], folder)
    with pytest.raises(InputError, match=r" leads out of the folder of results, to "):
        read_all(Results(folder))

    assert everything(tmp_path) == before


def test_a_folder_that_is_itself_a_link_is_as_good_as_another(made, folder, tmp_path):
    """Twin of the above."""
    (tmp_path / "link").symlink_to(folder)

    assert said_by(made[0], tmp_path / "link") == []
    assert len(Results.open(tmp_path / "link").cells) == 3


def test_a_key_that_leads_out_of_the_folder_is_refused(folder):
    with pytest.raises(InputError, match="leads out of the folder of results"):
        Results(folder).image("../../secret")


def test_a_pipe_among_results_is_refused(folder):
    path = only(folder, OF_CELLS[0])
    path.unlink()
    os.mkfifo(path)

    with pytest.raises(InputError, match=r"\.exr is a device or a pipe"):
        Results.open(folder).cells  # noqa: B018


def test_a_folder_that_may_only_be_read_stops_the_run_and_is_read(made, folder, monkeypatch):
    monkeypatch.setattr(os, "access", lambda path, mode: False)

    with pytest.raises(InputError, match=r"r: it is read-only; choose another folder with -o$"):
        run_study(made[0], folder)

    assert len(Results.open(folder).cells) == 3


# Another study in the folder


def test_a_part_of_a_study_leaves_the_fuller_results(made, folder):
    study, _, expected = made

    said = said_by(study.only(["flat"]), folder)

    assert said == [f"{folder} keeps its other results of this study: method regular_sampling"]
    assert remains(folder) == expected


def test_a_part_of_a_study_counts_towards_the_fuller_one(made, tmp_path):
    study, _, expected = made
    with pytest.raises(KeyboardInterrupt):
        run_study(study, tmp_path / "r", progress=Progress(cell=stop))

    run_study(study.only(["regular_sampling"]), tmp_path / "r")
    results = Results.open(tmp_path / "r")
    assert list(results.cells["method"]) == ["flat", "regular_sampling"]
    assert results.remarks(results.cells) == ["2 of 3 cells are done: the claims are judged on these"]
    run_study(study.only(["flat"]), tmp_path / "r")

    assert remains(tmp_path / "r") == expected


def test_a_fuller_study_takes_the_place_of_its_part(made, tmp_path):
    study, _, expected = made
    run_study(study.only(["flat"]), tmp_path / "r")

    assert said_by(study, tmp_path / "r") == []
    assert remains(tmp_path / "r") == expected


@pytest.mark.parametrize(
    ("change", "lost"),
    [
        ({"metrics": "[rms]"}, "metric flip"),
        ({"methods": "[{flat: {samples: [1, 3]}}, {regular_sampling: }]"}, "method flat"),
        ({"light": "constant"}, "light gradient"),
        ({"material": "{ggx: {alpha: 0.6}}"}, "material ggx"),
        ({"view": "{sphere: {resolution: 9}}"}, "view sphere"),
        ({"reference": "{relative_error: 0.06}"}, "reference relative_error 0.05"),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else "",
)
def test_results_that_another_study_would_lose_are_not_written_over(folder, tmp_path, change, lost):
    before = everything(folder)
    study = study_in(tmp_path, **{**STUDY, "claims": "[]", **change})

    with pytest.raises(InputError, match=rf"that would be lost: .*{lost}.*; choose another folder with -o$"):
        run_study(study, folder)

    assert everything(folder) == before


def test_results_of_another_seed_are_not_written_over(made, folder):
    with pytest.raises(InputError, match=r"that would be lost: .*seed 0; choose another folder with -o$"):
        run_study(made[0].with_seed(5), folder)


def test_more_metrics_and_another_title_lose_nothing(folder, tmp_path):
    """Twin of the above."""
    study = study_in(tmp_path, **{**STUDY, "title": "U", "metrics": "[rms, flip, mean_error]"})

    assert said_by(study, folder) == []
    assert Results(folder).study["title"] == "U"


# Not finished


def stop(row: object) -> None:
    raise KeyboardInterrupt


def test_results_of_a_run_that_was_stopped_are_read_and_say_how_far_it_is(made, tmp_path):
    study, folder, _ = made
    with pytest.raises(KeyboardInterrupt):
        run_study(study, tmp_path / "r", progress=Progress(cell=interrupting(lambda row: None, 1)))

    results = Results.open(tmp_path / "r")

    assert list(results.cells["key"]) == list(Results(folder).cells["key"][:2])
    assert results.remarks(results.cells) == ["2 of 3 cells are done: the claims are judged on these"]
    assert [claim["verdict"] for claim in results.claims] == ["not tested"]
    assert results.claims[0]["summary"].startswith("over 2 of 3 cells: ")
    assert results.study == study.resolved()
    assert results.provenance["finished"] == "not yet"


def test_results_without_a_single_cell_say_so(made, tmp_path):
    results = Results(tmp_path / "r")
    results.create()
    results.begin(made[0].resolved(), [{"key": "k", "light_options": "{}", "seed": 0}], {})

    with pytest.raises(InputError, match=r"r: none of 1 cells is done yet$"):
        Results.open(tmp_path / "r").cells  # noqa: B018


# JSON


def test_json_is_standard_and_numbers_come_back():
    row = {"a": float("nan"), "b": float("inf"), "c": -float("inf"), "d": 0.1 + 0.2, "e": "text", "f": True}

    text = seal(row)

    def refuse(word: str) -> None:
        raise ValueError(word)

    assert json.loads(text, parse_constant=refuse)["a"] is None
    again = restore_numbers(unseal(text))
    assert repr(again) == repr(row)


@pytest.mark.parametrize("change", [("0.1", "0.2"), ('"x"', '"y"'), ("}", ""), ("{", "[{")])
def test_sealed_json_notices_a_change(change):
    text = seal({"a": 0.1, "b": "x"})

    with pytest.raises(ValueError, match=r"its checksum|not a mapping|delimiter|Expecting"):
        unseal(text.replace(*change, 1))


def test_a_failed_cell_is_standard_json(tmp_path, monkeypatch):
    monkeypatch.setattr(Flat, "fails", True)

    run_study(study_in(tmp_path), tmp_path / "r")

    assert not [path for path in (tmp_path / "r").rglob("*.json") if b"NaN" in path.read_bytes()]


# Names


@pytest.mark.parametrize("name", ["run:1", "100 %", "a#b?c", "two\nlines", "ä" * 60, "s3://bucket"])
def test_results_go_into_a_folder_of_any_name(made, tmp_path, name):
    results = Results(tmp_path / name)

    run_study(made[0].only(["flat"]), results.folder)

    assert len(results.cells) == 2


def test_a_name_that_no_image_can_be_written_under_is_one_line(made, tmp_path):
    with pytest.raises(InputError, match=r"^cannot write results to '.*a\\udcff': the name is not UTF-8$"):
        run_study(made[0], tmp_path / os.fsdecode(b"a\xff"))
