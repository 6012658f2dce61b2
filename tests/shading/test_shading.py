import sys
from typing import Annotated

import pandas
import pytest
import torch
from pydantic import Field

import glossbench as gb
from glossbench import Method, MethodError, stage
from glossbench.commands.printing import err, warn_of_noise
from glossbench.envmap.cubemap import CubeMap, face_directions
from glossbench.errors import InputError
from glossbench.provenance import compute_source_hash
from glossbench.registry import Registry
from glossbench.shading.image import shade
from glossbench.shading.method import find_dependencies, order_stages
from glossbench.shading.stage_cache import StageCache

LIGHT = gb.light("gradient", resolution=16)
MATERIAL = gb.material("kurt", m=0.3)
VIEW = gb.view("sphere", resolution=6)


class Chain(Method):
    """Stages written in the wrong order; calls are counted outside."""

    gain: Annotated[float, Field(ge=0, le=10)] = 1.0
    shift: Annotated[float, Field(ge=0, le=10)] = 0.0

    @stage
    def last(self, first, material):
        return first + material.kd[0]

    @stage
    def first(self, light):
        CALLS.append("first")
        return light.mean().float() * self.gain

    @stage
    def frame(self, view):
        return torch.zeros(3)

    def shade(self, points, last, frame):
        return (last + frame + self.shift).expand(len(points), 3).clone()


CALLS: list[str] = []


def test_stages_run_in_the_order_of_their_names():
    order = list(order_stages(Chain))

    assert order.index("first") < order.index("last")


def test_a_stage_depends_on_the_inputs_of_the_stages_before_it():
    depends = find_dependencies(order_stages(Chain))

    assert depends == {"first": {"light"}, "last": {"light", "material"}, "frame": {"view"}}


def test_update_cost_is_that_of_the_stages_which_the_change_reaches():
    image = shade(Chain(), LIGHT, MATERIAL, VIEW)

    seconds, update = image.costs.stage_seconds, image.costs.update_seconds
    assert update["light"] == pytest.approx(seconds["first"] + seconds["last"])
    assert update["material"] == pytest.approx(seconds["last"])
    assert update["geometry"] == 0
    assert update["view"] == pytest.approx(seconds["frame"])


def test_a_stage_is_shared_between_methods_that_differ_only_in_options_that_it_does_not_read():
    CALLS.clear()
    cache = StageCache()

    for options in ({}, {"shift": 2.0}, {"gain": 3.0}, {"gain": 3.0, "shift": 1.0}):
        shade(Chain(**options), LIGHT, MATERIAL, VIEW, cache=cache, time_it=False)

    assert len(CALLS) == 2  # one for each gain


@stage
def scaled(self, light):
    """By the method's `scale`, where it has one."""
    return torch.full((3,), getattr(self, "scale", 1.0))


class Plain(Method):
    """A method without the option that its shared stage asks for."""

    scaled = scaled

    def shade(self, points, scaled):
        return scaled.expand(len(points), 3).clone()


class Scaled(Plain):
    """The same with it."""

    scale: float = 2.0


def test_a_method_without_an_option_never_lends_its_stage_to_one_that_has_it():
    for first, second in ((Plain(), Scaled()), (Scaled(), Plain())):
        cache = StageCache()

        images = [shade(m, LIGHT, MATERIAL, VIEW, cache=cache, time_it=False) for m in (first, second)]

        assert [float(i.radiance.max()) for i in images] == [getattr(m, "scale", 1.0) for m in (first, second)]


def test_a_stage_made_without_timing_is_timed_warm_when_its_time_counts(several_runs):
    CALLS.clear()
    cache = StageCache()

    shade(Chain(), LIGHT, MATERIAL, VIEW, cache=cache, time_it=False)
    n_untimed = len(CALLS)
    shade(Chain(), LIGHT, MATERIAL, VIEW, cache=cache, time_it=True)
    n_timed = len(CALLS)
    shade(Chain(), LIGHT, MATERIAL, VIEW, cache=cache, time_it=True)

    assert n_untimed == 1
    assert n_timed >= 3  # a warming run and at least one that counts
    assert len(CALLS) == n_timed


class AbstractValue(Method):
    """A stage that asks a helper, which each subclass has for itself."""

    @stage
    def value(self, light):
        return torch.full((3,), self.helper())

    def shade(self, points, value):
        return value.expand(len(points), 3).clone()


class One(AbstractValue):
    """1"""

    def helper(self):
        return 1.0


class Two(AbstractValue):
    """2"""

    def helper(self):
        return 2.0


def test_an_inherited_stage_is_not_shared_by_classes_whose_helpers_differ():
    cache = StageCache()

    one, two = (shade(m, LIGHT, MATERIAL, VIEW, cache=cache, time_it=False) for m in (One(), Two()))

    assert float(one.radiance.max()) == 1
    assert float(two.radiance.max()) == 2


def test_two_lights_without_a_name_are_not_taken_for_one():
    cache = StageCache()
    dark, bright = (CubeMap(torch.full((6, 4, 4, 3), value)) for value in (1.0, 2.0))

    images = [shade(Chain(), light, MATERIAL, VIEW, cache=cache, time_it=False) for light in (dark, bright)]

    assert [float(image.radiance.max()) for image in images] == pytest.approx([1, 2])


class Circular(Method):
    """Two stages that wait for each other."""

    @stage
    def a(self, b):
        return b

    @stage
    def b(self, a):
        return a

    def shade(self, points, a):
        return a


class Asking(Method):
    """Asks for what nothing provides."""

    def shade(self, points, materials):
        return materials


class Shadeless(Method):
    """Has no shade."""


@pytest.mark.parametrize(
    ("method", "line"),
    [
        (Circular, "Circular: the stages a, b wait for each other"),
        (Asking, "Asking.shade asks for 'materials': no input and no stage has that name"),
        (Shadeless, r"Shadeless has no shade\(self, points, material, ...\)"),
    ],
)
def test_a_method_that_cannot_run_says_why_in_one_line(method, line):
    with pytest.raises(InputError, match=f"^{line}$"):
        order_stages(method)


def returning(make):
    """A method whose shade returns make(number of points)."""

    class Planted(Method):
        """Planted."""

        def shade(self, points):
            return make(len(points))

    Planted.name = "planted"
    return Planted()


@pytest.mark.parametrize(
    ("make", "line"),
    [
        (lambda n: [0.0] * n, "must return a tensor, got list"),
        (lambda n: torch.zeros(n), r"must return \(32, 3\) float32, got \(32,\) float32"),
        (lambda n: torch.zeros(n, 3).double(), r"must return \(32, 3\) float32, got \(32, 3\) float64"),
        (lambda n: torch.full((n, 3), float("nan")), "32 points are not finite"),
    ],
)
def test_a_method_that_breaks_the_interface_is_named(make, line):
    with pytest.raises(MethodError, match=f"planted.shade.*{line}"):
        shade(returning(make), LIGHT, MATERIAL, VIEW)


def test_a_class_of_a_package_changes_its_hash_with_any_module_of_the_package(tmp_path, monkeypatch):
    package = tmp_path / "planted_lab"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "helper.py").write_text("FACTOR = 1.0\n")
    (package / "method.py").write_text("from planted_lab.helper import FACTOR\n\nclass Planted:\n    pass\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    import planted_lab.method  # noqa: F401

    before = compute_source_hash(sys.modules["planted_lab.method"].Planted)
    (package / "helper.py").write_text("FACTOR = 7.0\n")

    assert compute_source_hash(sys.modules["planted_lab.method"].Planted) != before


def test_classes_of_two_files_of_this_package_have_two_hashes():
    assert compute_source_hash(type(MATERIAL)) != compute_source_hash(type(VIEW))


def test_lod_bias_and_k_together_are_an_error():
    with pytest.raises(InputError, match=r"lod_bias replaces k, got both 'plain' and 2\.0"):
        gb.method("filtered_importance_sampling", lod_bias="plain", k=2.0)


def test_a_broken_entry_point_is_one_warning_and_the_rest_is_loaded(monkeypatch, caplog):
    class Broken:
        name, dist = "lab", None

        def load(self):
            raise ImportError("no module named lab\nsecond line")

    monkeypatch.setattr("glossbench.registry.entry_points", lambda group: [Broken()])
    registry = Registry("method", "glossbench.methods", "planted.group")

    assert registry.names() == []  # its modules were imported before, and registered elsewhere
    assert [r.getMessage() for r in caplog.records] == [
        "method 'lab' of ? cannot be loaded: ImportError: no module named lab"
    ]


def test_face_directions_stay_on_the_device_of_their_coordinates():
    s = torch.zeros(5, device="meta")

    d = face_directions(s, s)

    assert {c.device.type for c in d} == {"meta"}


@pytest.mark.parametrize(
    ("method", "noise", "warned"),
    [("sampling", 0.02, True), ("sampling", 0.014, False), ("summation", 0.02, True), ("summation", 0.014, True),
     ("summation", 0.01, False), ("", 0.014, True)],
)  # fmt: skip
def test_a_reference_that_missed_its_noise_target_is_reported(method, noise, warned):
    """That of samples, whose halves end by the noise of each other, may be missed by half."""
    reference = {"reference_noise": noise, "reference_target": 0.01, "reference_mean": 2.0, "reference_method": method}
    cells = pandas.DataFrame([{"reference_key": "a"} | reference])

    with err.capture() as capture:
        warn_of_noise(cells)

    line = "1 of 1 references stopped at reference.max_samples with noise up to"
    assert (f"{line} {50 * noise:.2g} % of the mean; the target was 0.5 %" in capture.get()) == warned
