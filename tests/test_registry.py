"""Names are found at the first use, from any thread, and after an import that was interrupted."""

import pickle
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from glossbench import registry as module
from glossbench.brdf.material import MATERIALS
from glossbench.envmap.lights.light import LIGHTS
from glossbench.errors import InputError
from glossbench.metrics import METRICS
from glossbench.options import Options
from glossbench.registry import Registry
from glossbench.scene.points import VIEWS
from glossbench.shading.method import METHODS

HOME = """
import time, sys
from glossbench.{name} import REGISTRY
from glossbench.options import Options
{before}
@REGISTRY.register("{word}")
class Thing(Options):
    pass
{after}
"""


class Point:
    """An entry point of a distribution."""

    name, dist = "plugin", None

    def __init__(self, load):
        self.load = load


@pytest.fixture
def home(tmp_path, monkeypatch):
    """Writes modules of a package `house`, and returns a registry whose home that is."""
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "house").mkdir()
    (tmp_path / "house" / "__init__.py").write_text("")
    registry = Registry("thing", "house", "glossbench.no_such_group")
    monkeypatch.setitem(sys.modules, "glossbench.of_tests", type(sys)("glossbench.of_tests"))
    sys.modules["glossbench.of_tests"].REGISTRY = registry

    def written(**words):
        for word, (before, after) in words.items():
            source = HOME.format(name="of_tests", word=word, before=before, after=after)
            (tmp_path / "house" / f"{word}.py").write_text(source)
        return registry

    yield written
    for name in [name for name in sys.modules if name.partition(".")[0] == "house"]:
        del sys.modules[name]


def test_threads_that_ask_at_once_all_get_all_names(home):
    registry = home(first=("", ""), second=("time.sleep(0.05)", ""), third=("time.sleep(0.05)", ""))
    begin = threading.Barrier(4)

    def ask(_):
        begin.wait(5)
        return registry.names()

    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(ask, range(4))) == [["first", "second", "third"]] * 4


def test_a_registry_that_is_marked_as_full_too_early_would_be_noticed(home):
    registry = home(first=("time.sleep(0.3)", ""))
    other = threading.Thread(target=registry.names)
    other.start()
    time.sleep(0.05)
    registry._discovered = True  # as it once was from the beginning

    with pytest.raises(InputError, match="unknown thing 'first'"):
        registry.get("first")
    other.join()


@pytest.mark.parametrize("fault", ["KeyboardInterrupt", "ImportError", "MemoryError"])
def test_an_interrupted_import_is_begun_again(home, monkeypatch, fault):
    registry = home(first=("", ""), second=(f"if not hasattr(sys, 'is_calm'): raise {fault}", ""), third=("", ""))
    with pytest.raises((KeyboardInterrupt, ImportError, MemoryError)):
        registry.get("third")

    monkeypatch.setattr(sys, "is_calm", True, raising=False)

    assert registry.names() == ["first", "second", "third"]


def test_a_module_may_ask_for_names_while_it_is_imported(home):
    registry = home(first=("", ""), second=("REGISTRY.get('first')", ""))

    assert registry.names() == ["first", "second"]


def test_what_a_plug_in_registered_before_it_failed_is_not_kept(home, monkeypatch, caplog):
    registry = home(first=("", ""))

    def load():
        cls = type("Thing", (Options,), {"__module__": "a_module_that_failed"})
        registry.register("half")(cls)
        raise RuntimeError("then this")

    monkeypatch.setattr(module, "entry_points", lambda group: [Point(load)])

    assert registry.names() == ["first"]
    assert "then this" in caplog.text


@pytest.mark.parametrize("registry", [LIGHTS, MATERIALS, VIEWS, METHODS, METRICS], ids=lambda each: each.kind)
def test_every_class_of_a_name_can_be_sent_to_a_worker(registry):
    classes = list(map(registry.get, registry.names()))

    assert pickle.loads(pickle.dumps(classes)) == classes
