"""Processes that are forked off after glossbench was used: they work, or say why not; none waits for ever."""

import os
import signal

import pytest
import torch

import glossbench as gb
from glossbench.process.surroundings import settled
from glossbench.reports import typesetting

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")


def in_child(work, seconds=20):
    """Whether the work is true in a forked process; an alarm ends one that hangs."""
    child = os.fork()
    if child == 0:
        signal.alarm(seconds)
        code = 1
        try:
            code = 0 if work() else 1
        finally:
            os._exit(code)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


def parallel():
    """The sum of so many numbers that OpenMP's threads share the work."""
    return float(torch.ones(1 << 18).exp().sum())


@pytest.fixture
def threads():
    """More than one thread, which have worked."""
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    with settled():
        expected = parallel()
    yield expected
    torch.set_num_threads(before)


def test_a_forked_process_works_alone_and_has_the_same_result(threads):
    assert in_child(lambda: parallel() == threads and torch.get_num_threads() == 1)
    assert torch.get_num_threads() == 2


def test_flip_works_in_a_forked_process(threads):
    view = gb.view("sphere", resolution=32)
    light, material = gb.light("constant", resolution=8), gb.material("ggx", alpha=0.5)
    image = gb.shade(gb.method("importance_sampling", samples=4), light, material, view)
    flip = gb.metric("flip")
    assert flip(image, image) == 0

    assert in_child(lambda: flip(image, image) == 0)


def test_a_fork_in_the_middle_of_a_call_has_its_own_switches():
    torch.set_default_dtype(torch.float64)
    try:
        with settled():
            assert in_child(lambda: torch.get_default_dtype() == torch.float32)
        assert in_child(lambda: torch.get_default_dtype() == torch.float64)
    finally:
        torch.set_default_dtype(torch.float32)


def test_reports_in_a_fork_of_a_process_that_wrote_some_are_refused():
    def is_refused():
        with pytest.raises(gb.InputError, match="start processes by spawn"), typesetting.Press():
            pass
        return True

    with typesetting.Press():
        pass

    assert in_child(is_refused)
