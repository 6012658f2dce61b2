"""The alarm interrupts Python code, but no import: a module that is half-made could not be imported again."""

import sys
import time

import pytest

from glossbench.process import time_limit
from glossbench.process.time_limit import alarm

SLOW = """
import time
began = time.perf_counter()
while time.perf_counter() - began < 0.4:
    pass
whole = True
"""


@pytest.fixture
def slow_module(tmp_path, monkeypatch):
    """The name of a module whose import takes longer than the alarm."""
    name = "slow_to_import"
    (tmp_path / f"{name}.py").write_text(SLOW)
    monkeypatch.syspath_prepend(tmp_path)
    yield name
    sys.modules.pop(name, None)


def import_and_loop(name):
    __import__(name)
    while True:
        time.sleep(0.01)


def test_an_import_ends_before_the_code_that_imports_is_interrupted(slow_module):
    began = time.perf_counter()

    with pytest.raises(TimeoutError, match=r"time limit of 0\.1 s"), alarm(0.1):
        import_and_loop(slow_module)

    assert sys.modules[slow_module].whole
    assert 0.4 <= time.perf_counter() - began < 2


def test_without_a_look_at_imports_the_module_is_not_made(slow_module, monkeypatch):
    monkeypatch.setattr(time_limit, "count_imports", lambda frame: 0)

    with pytest.raises(TimeoutError), alarm(0.1):
        __import__(slow_module)

    assert slow_module not in sys.modules


def test_a_block_that_stands_in_an_import_itself_is_interrupted(tmp_path, monkeypatch):
    """As in a script that is imported and runs a study."""
    (tmp_path / "imported_script.py").write_text(
        "import time\nfrom glossbench.process.time_limit import alarm\n"
        "try:\n    with alarm(0.05):\n        while True: time.sleep(0.01)\nexcept TimeoutError: interrupted = True\n"
    )
    monkeypatch.syspath_prepend(tmp_path)

    script = __import__("imported_script")

    sys.modules.pop("imported_script")
    assert script.interrupted
