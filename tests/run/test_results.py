"""What a run leaves on disk: whole files, read back as they were written."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import torch

from glossbench import atomic
from glossbench.atomic import replacing
from glossbench.errors import InputError
from glossbench.metrics import METRICS
from glossbench.run.cell_files import make_key
from glossbench.run.results import Results
from glossbench.shading.image import Image
from glossbench.truth.reference import Reference


@pytest.fixture
def results(tmp_path) -> Results:
    made = Results(tmp_path / "results")
    made.create()
    return made


def hidden(folder: Path) -> list[str]:
    return [path.name for path in folder.rglob(".*")]


def dead_process() -> int:
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


def test_a_key_does_not_depend_on_the_order_of_mappings_but_on_that_of_lists():
    assert make_key([{"a": 1, "b": 2}]) == make_key([{"b": 2, "a": 1}])
    assert make_key(["a", "b"]) != make_key(["b", "a"])


def test_a_file_that_is_replaced_appears_only_when_all_is_written(tmp_path):
    target = tmp_path / "file"
    target.write_text("old")

    with replacing(target) as part:
        part.write_text("new")
        before = target.read_text()

    assert (before, target.read_text(), hidden(tmp_path)) == ("old", "new", [])


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_a_write_that_breaks_leaves_the_old_file_and_no_other(tmp_path, error):
    target = tmp_path / "file"
    target.write_text("old")

    def write() -> None:
        with replacing(target) as part:
            part.write_text("half")
            raise error

    with pytest.raises(error):
        write()

    assert [path.name for path in tmp_path.iterdir()] == ["file"]
    assert target.read_text() == "old"


def test_a_cell_is_read_back_bit_for_bit(results):
    row = {"key": "k", "rms": 0.1 + 0.2, "nothing": float("nan"), "text": "ä\n[/x]", "n": 3, "floor": True}
    radiance = torch.rand(3, 4, 3, generator=torch.Generator().manual_seed(1)) * 1e4
    pattern = np.array([[0.1, 0.2]], dtype=np.float32)

    results.add_cell(row, Image(radiance, torch.ones(3, 4, dtype=torch.bool)), pattern)

    again = results.cell("k")
    assert np.isnan(again.pop("nothing"))
    assert again == {key: value for key, value in row.items() if key != "nothing"}
    assert results.image("k").tobytes() == radiance.numpy().tobytes()
    assert results.half_vectors("k").tobytes() == pattern.tobytes()
    assert hidden(results.folder) == []


def test_a_cell_written_again_keeps_no_flip_map_of_its_old_image(results):
    kept = {key: results.folder / "images" / f"{key}_flip_1.npz" for key in ("k", "other")}
    for path in (*kept.values(), results.folder / "images" / "k.exr"):
        path.write_bytes(b"")

    results.add_cell({"key": "k"}, Image(torch.zeros(2, 2, 3), torch.ones(2, 2, dtype=torch.bool)), None)

    assert not kept["k"].exists()
    assert kept["other"].exists()


def test_a_reference_is_read_back_in_single_precision(results):
    generator = torch.Generator().manual_seed(2)
    radiance, error = torch.rand(2, 5, 4, 3, generator=generator, dtype=torch.float64)
    mask = torch.rand(5, 4, generator=generator) < 0.5

    deviates = torch.randn(8, 5, 4, 3, generator=generator).half()

    results.add_reference("k", Reference(radiance, error, mask, 2048, deviates), 1.5)

    assert results.has_reference("k")
    assert results.reference("k").tobytes() == radiance.float().numpy().tobytes()
    assert results.standard_error("k").tobytes() == error.float().numpy().tobytes()
    assert results.deviates("k").tobytes() == deviates.numpy().tobytes()
    assert (results.mask("k") == mask.numpy()).all()
    assert results.reference_numbers("k") == {"n_samples": 2048, "seconds": 1.5, "method": "sampling"}
    assert hidden(results.folder) == []


@pytest.mark.parametrize("suffix", ["images/k.exr", "references/k.exr", "references/k_mask.png"])
def test_a_cell_counts_as_done_only_by_its_row(results, suffix):
    (results.folder / suffix).touch()

    assert not results.has_cell("k")
    assert not results.has_reference("k")


def test_text_that_looks_like_a_number_stays_text_in_the_study(results):
    study = {"title": "1e-3", "source": "yes", "question": "12:30", "seed": 3, "x": 1e-7, "y": 1e-3}

    results.finish(study, [], [{"key": "k", "light": "spots", "material": "ggx", "view": "sphere"}], {})

    assert results.study == study


def part_of(target: Path, writer: int, host: str | None = None) -> Path:
    """A half-written file, as a killed process leaves it."""
    with replacing(target) as part:
        part.write_text("half")
    target.unlink()
    words = part.name.split("-")
    left = part.with_name("-".join([words[0], host or words[1], str(writer), *words[3:]]))
    left.write_text("half")
    return left


def test_what_a_killed_writer_left_is_removed(results):
    writer = dead_process()
    for name in ("cells/k.json", "images/k.exr", "references/k_mask.png", "cells.parquet"):
        part_of(results.folder / name, writer)
    assert len(hidden(results.folder)) == 4

    results.create()

    assert hidden(results.folder) == []


def test_what_was_left_long_ago_elsewhere_is_removed(results):
    left = part_of(results.folder / "cells" / "k.json", 1, host="0" * 12)
    os.utime(left, (time.time() - 2 * atomic.ABANDONED,) * 2)

    results.create()

    assert hidden(results.folder) == []


def test_what_may_still_be_written_is_spared(results):
    """Twin of the above: by a living process, by this one, by one of another machine or container."""
    target = results.folder / "cells" / "k.json"
    kept = [part_of(target, os.getppid()), part_of(target, os.getpid()), part_of(target, dead_process(), "0" * 12)]

    results.create()

    assert set(kept) <= set((results.folder / "cells").iterdir())


def test_hidden_files_of_others_are_spared(results):
    left = part_of(results.folder / "k.json", dead_process())
    (results.folder / "cells" / "deep").mkdir()
    others = [
        "cells/.99999.private.key", ".2023.csv.swp", f"images/.{dead_process()}.k.exr", "cells/deep/.gitignore",
        f"cells/deep/{left.name}", f"cells/{left.name}.txt", f"images/{left.name[1:]}",
    ]  # fmt: skip
    for name in others:
        (results.folder / name).write_text("precious")
    linked = results.folder / "references" / left.name
    linked.symlink_to(results.folder / others[0])

    results.create()

    assert all((results.folder / name).read_text() == "precious" for name in others)
    assert linked.is_symlink()
    assert not left.exists()


def test_two_processes_of_one_number_write_the_same_file(results, monkeypatch):
    monkeypatch.setattr(os, "getpid", lambda: 1)
    target = results.folder / "file"

    with replacing(target) as first:
        with replacing(target) as second:
            second.write_text("second")
        first.write_text("first")

    assert target.read_text() == "first"
    assert hidden(results.folder) == []


@pytest.mark.parametrize("name", ["a" * 255, "a." + "b" * 253, "ä" * 127, "run:1", "100 %#?\n.txt"])
def test_every_name_that_a_file_may_have_is_written(tmp_path, name):
    with replacing(tmp_path / name) as part:
        part.write_text("new")

    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_a_terminated_process_leaves_no_half_written_file(tmp_path):
    def write() -> None:
        with replacing(tmp_path / "file") as part:
            part.write_text("half")
            os.kill(os.getpid(), signal.SIGTERM)
            time.sleep(5)

    with pytest.raises(KeyboardInterrupt):
        write()

    assert list(tmp_path.iterdir()) == []
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


def test_a_file_is_on_the_disk_before_it_bears_its_name(tmp_path, monkeypatch):
    did = []
    for call in ("fsync", "replace"):
        really = getattr(os, call)
        monkeypatch.setattr(os, call, lambda *args, call=call, really=really: (did.append(call), really(*args)))

    with replacing(tmp_path / "file") as part:
        part.write_text("new")

    assert did == ["fsync", "replace", "fsync"]


@pytest.mark.parametrize("path", ["file", "file/below", "file/much/below"])
def test_a_file_in_the_way_of_the_folder_is_an_error(tmp_path, path):
    (tmp_path / "file").write_text("here")

    with pytest.raises(InputError, match=r"^cannot write results to .*: (File exists|Not a directory)$"):
        Results(tmp_path / path).create()

    assert (tmp_path / "file").read_text() == "here"


def test_a_folder_without_results_is_an_error(tmp_path):
    with pytest.raises(InputError, match=r"holds no results: cells.parquet is missing$"):
        Results.open(tmp_path)


def test_the_metric_of_a_column_has_the_options_that_the_study_states(tmp_path):
    results = Results(tmp_path)
    (tmp_path / "study.yaml").write_text("metrics: [rms, flip: {pixels_per_degree: 40.0}]\n")

    assert results.metric("flip") == METRICS.create("flip", {"pixels_per_degree": 40.0})
    assert results.metric("flip") != METRICS.create("flip", {})
    assert results.metric("smape") == METRICS.create("smape", {})
    assert results.metric("of_a_plug_in") is None
