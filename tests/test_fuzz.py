"""Mutated studies and images load or are refused, in a separate process, which a native library may kill."""

import random
import signal
import sys
import time
from pathlib import Path

import pytest

from glossbench.errors import InputError
from oracles import fuzz
from oracles.forks import ran

# 2000 mutated studies are refused from 44 places of the code, 1000 of them from 41; an image takes a thousandth of a
# second, a study twenty.
N_INPUTS = {"studies": 1000, "images": 2000}
RUN = """
import sys
from oracles import fuzz
for given in {calls}:
    sys.argv[1:] = given
    if fuzz.main():
        sys.exit(1)
"""


def test_mutated_studies_and_images_load_or_are_refused(tmp_path):
    logs = {target: tmp_path / target for target in ("studies", "images")}
    calls = [[target, str(n), "--log", str(logs[target])] for target, n in N_INPUTS.items()]

    done = ran(RUN.format(calls=calls), log=tmp_path / "log", seconds=600)

    at = {target: log.read_text() for target, log in logs.items() if log.exists()}
    assert done.returncode == 0, f"at the end at number {at}:\n{done.stdout}{done.stderr}"
    assert at == {target: str(n - 1) for target, n in N_INPUTS.items()}


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
    program = "import os\nfrom oracles import fuzz\nfuzz.load_study = lambda path: os.abort()\nfuzz.main()"

    done = ran(program, "studies", "2", "--seed", "7", "--log", tmp_path / "log", log=tmp_path / "said")

    assert done.returncode == -signal.SIGABRT
    assert (tmp_path / "log").read_text() == "7"
