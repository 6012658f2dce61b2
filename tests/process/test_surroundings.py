"""The process of a user: its switches change no number, and a call changes none of them."""

import random
import threading
from contextlib import ExitStack, contextmanager

import numpy as np
import pytest
import torch

import glossbench as gb
from glossbench.process import surroundings
from glossbench.process.surroundings import settled


@contextmanager
def default_dtype():
    torch.set_default_dtype(torch.float64)
    try:
        yield
    finally:
        torch.set_default_dtype(torch.float32)


@contextmanager
def default_device():
    torch.set_default_device("meta")
    try:
        yield
    finally:
        torch.set_default_device(None)


@contextmanager
def deterministic():
    torch.use_deterministic_algorithms(True, warn_only=True)
    try:
        yield
    finally:
        torch.use_deterministic_algorithms(False)


@contextmanager
def matmul_precision():
    torch.set_float32_matmul_precision("medium")
    try:
        yield
    finally:
        torch.set_float32_matmul_precision("highest")


@contextmanager
def seeds():
    state = torch.get_rng_state()
    torch.manual_seed(99)
    yield
    torch.set_rng_state(state)


SWITCHES = {
    "default dtype": default_dtype,
    "default device": default_device,
    "a device in a block": lambda: torch.device("meta"),
    "autocast": lambda: torch.autocast("cpu", dtype=torch.bfloat16),
    "inference mode": torch.inference_mode,
    "no gradients": torch.no_grad,
    "deterministic algorithms": deterministic,
    "precision of products": matmul_precision,
    "errors of numpy": lambda: np.errstate(all="raise"),
    "seeds": seeds,
}


def states():
    """All that a call must leave as it was."""
    return {
        "dtype": torch.get_default_dtype(),
        "device": str(torch.get_default_device()),
        "autocast": torch.is_autocast_enabled("cpu"),
        "inference": torch.is_inference_mode_enabled(),
        "gradients": torch.is_grad_enabled(),
        "deterministic": torch.are_deterministic_algorithms_enabled(),
        "warns": torch.is_deterministic_algorithms_warn_only_enabled(),
        "products": torch.get_float32_matmul_precision(),
        "threads": torch.get_num_threads(),
        "numpy": np.geterr(),
        "torch's randomness": torch.get_rng_state().tolist(),
        "numpy's randomness": str(np.random.get_state(legacy=False)),  # noqa: NPY002
        "Python's randomness": random.getstate(),
        "denormals": torch.tensor(1e-40, dtype=torch.float32, device="cpu").mul(1).item() > 0,
    }


def numbers(more=()):
    """A bit of all that the package computes, as bytes."""
    light = gb.light("sky", resolution=8)
    material, view = gb.material("phong", s=20.0), gb.view("sphere", resolution=4)
    truth = gb.reference(light, material, view, relative_error=1.0)
    found = [light.faces, truth.radiance, truth.standard_error]
    for name, options in {
        "importance_sampling": {"samples": 4},
        "filtered_importance_sampling": {"samples": 4},
        "many_lights": {},
        **dict(more),
    }.items():
        image = gb.shade(gb.method(name, **options), light, material, view)
        found += [image.radiance, np.float64(gb.metric("relative_rms")(image, truth))]
    found += [gb.light("spots", seed=3, resolution=16).faces, gb.metric("rms").error_map(image, truth)]
    found += list(gb.view("mesh", shape="bowl", resolution=4).points().n)
    return [(values.detach().numpy() if isinstance(values, torch.Tensor) else values).tobytes() for values in found]


@pytest.fixture(scope="module")
def expected():
    return numbers()


@pytest.mark.parametrize("switch", SWITCHES.values(), ids=list(SWITCHES))
def test_a_switch_of_the_process_changes_no_byte_and_is_left_as_it_was(expected, switch):
    with switch():
        before = states()

        found = numbers()

        assert states() == before
    assert found == expected


def test_all_switches_at_once_change_no_byte():
    slow = {"partial_environment_maps": {"regions": 6}}
    expected = numbers(slow)

    with ExitStack() as stack:
        for name, switch in SWITCHES.items():
            if name != "default device":
                stack.enter_context(switch())

        assert numbers(slow) == expected


def test_numbers_that_do_not_settle_the_state_would_be_noticed(expected, monkeypatch):
    monkeypatch.setattr(surroundings._this_thread, "is_within", True, raising=False)  # as if it were done

    with default_dtype(), pytest.raises((RuntimeError, AssertionError)):
        assert numbers() == expected


def test_a_tensor_made_in_inference_mode_can_be_used_outside_it():
    with torch.inference_mode():
        light = gb.light("gradient", resolution=16)

    assert not light.faces.is_inference()


def test_an_error_within_a_call_leaves_the_state_as_it_was():
    with default_dtype():
        with pytest.raises(gb.InputError):
            gb.light("spots", resolution=3)

        assert torch.get_default_dtype() == torch.float64


def test_the_last_of_several_threads_puts_the_switches_back():
    inside, leave = threading.Event(), threading.Event()

    def long_call():
        with settled():
            inside.set()
            leave.wait(10)

    with default_dtype():
        other = threading.Thread(target=long_call)
        other.start()
        inside.wait(10)
        with settled():
            pass
        during = torch.get_default_dtype()
        leave.set()
        other.join()

        assert (during, torch.get_default_dtype()) == (torch.float32, torch.float64)
