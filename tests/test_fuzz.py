"""Mutated studies and images load or are refused, in a process of their own, which a native library may kill."""

import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
import fuzz

from glossbench.errors import InputError

PROGRAM = Path(fuzz.__file__)
N_INPUTS = 2000


def test_mutated_studies_and_images_load_or_are_refused(tmp_path):
    logs = {target: tmp_path / target for target in ("studies", "images")}
    processes = {
        target: subprocess.Popen([sys.executable, PROGRAM, target, str(N_INPUTS), "--log", log],
                                 stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        for target, log in logs.items()
    }  # fmt: skip

    for target, process in processes.items():
        out, _ = process.communicate(timeout=600)
        assert process.returncode == 0, f"{target}, number {logs[target].read_text()} at the end:\n{out}"


def test_an_input_is_made_from_its_number_alone():
    content = b"title: T\nlight: constant\n" * 20

    twice = [[fuzz.mutated(content, b"other: 1", True, random.Random(n)) for n in range(50)] for _ in range(2)]

    assert twice[0] == twice[1]
    assert len(set(twice[0])) > 45
    assert all(made != content for made in twice[0][:10])


def leaves_a_file(path: Path) -> None:
    path.with_name("x.part").touch()


def refuses_in_two_lines(path: Path) -> None:
    raise InputError("a\nb")


@pytest.mark.parametrize(
    ("load", "fault"),
    [
        (lambda path: {}[3], "number 7, study.yaml: KeyError: 3"),
        (lambda path: sys.exit(0), "number 7, study.yaml: SystemExit: 0"),
        (lambda path: time.sleep(100), "number 7, study.yaml: TimeoutError: took more than 0.2 s"),
        (leaves_a_file, "number 7, study.yaml: left x.part behind"),
        (refuses_in_two_lines, "number 7, study.yaml: 2 lines: a\nb"),
    ],
)
def test_the_fuzzer_notices(monkeypatch, load, fault):
    monkeypatch.setattr(fuzz, "SECONDS", 0.2)

    outcomes = fuzz.outcomes_of(load, [("study.yaml", b"title: T")], range(7, 8))

    assert outcomes[fault] == 1


def test_the_number_of_an_input_that_kills_the_process_is_known(tmp_path):
    program = f"import sys; sys.path.insert(0, {str(PROGRAM.parent)!r})\nimport fuzz, os\n" \
              "fuzz.load_study = lambda path: os.abort()\nfuzz.main()"  # fmt: skip
    command = [sys.executable, "-c", program, "studies", "2", "--seed", "7", "--log", tmp_path / "log"]

    done = subprocess.run(command, capture_output=True, timeout=120)

    assert done.returncode == -signal.SIGABRT
    assert (tmp_path / "log").read_text() == "7"
