"""The cache of stages: each cell gets the value that it gets alone, memory is bounded, modified values are not used."""

import pytest
import torch

from glossbench.envmap.lights.synthetic import Constant
from glossbench.errors import MethodError
from glossbench.shading.image import prepare
from glossbench.shading.method import Method, stage
from glossbench.shading.stage_cache import MUCH, StageCache, read_option

LIGHT = Constant(radiance=(1.0, 1.0, 1.0), resolution=2).cubemap()
INPUTS = {"light": LIGHT, "material": "m", "scene": "s", "view": "v"}


class Chained(Method):
    """Each stage is made of the one before; the first alone reads the option."""

    x: float = 0.0

    @stage
    def first(self, light):
        return torch.full((256,), self.x)

    @stage
    def second(self, first):
        return first + 1

    @stage
    def third(self, second):
        return second * 2

    def shade(self, points, third):
        return third[:3].expand(len(points), 3)


def third_of(x: float, cache: StageCache, patience: float = 0.0) -> float:
    return float(prepare(Chained(x=x), INPUTS, cache, patience)["third"].value[0])


def tuned_and_timed(cache: StageCache) -> list[float]:
    """What cells get that are tuned over the option, then timed, as objects come and go between them."""
    found = []
    for x in range(8):
        junk = [torch.zeros(i) for i in range(x)]
        found.append(third_of(x, cache))
        del junk
        found.append(third_of(x, cache, patience=1e-6))
    return found


def test_a_chain_of_stages_gives_each_cell_what_it_gets_alone():
    cache = StageCache()

    for _ in range(10):
        assert tuned_and_timed(cache) == [2.0 * (x + 1) for x in range(8) for _ in range(2)]


def test_a_key_without_the_options_that_were_read_would_be_wrong(monkeypatch):
    """Twin of the above: a stage is known by its function and its inputs alone."""
    monkeypatch.setattr("glossbench.shading.stage_cache._make_hashable", lambda value: 0)

    assert tuned_and_timed(StageCache()) != [2.0 * (x + 1) for x in range(8) for _ in range(2)]


def test_a_chain_gives_the_right_values_when_nothing_fits_the_cache():
    assert tuned_and_timed(StageCache(limit=0)) == [2.0 * (x + 1) for x in range(8) for _ in range(2)]


def test_the_least_recently_used_value_is_dropped_first():
    cache = StageCache(limit=2 * 3 * 1024)  # two chains of three stages of 1 KiB

    first, second = (prepare(Chained(x=x), INPUTS, cache)["first"] for x in (0.0, 1.0))
    again = prepare(Chained(x=0.0), INPUTS, cache)["first"]
    prepare(Chained(x=2.0), INPUTS, cache)

    assert again is first
    assert prepare(Chained(x=0.0), INPUTS, cache)["first"] is first
    assert prepare(Chained(x=1.0), INPUTS, cache)["first"] is not second


@pytest.mark.parametrize(("later", "is_kept"), [([1.0, 0.0], True), ([1.0], False)])
def test_much_memory_is_freed_of_what_no_later_method_takes(monkeypatch, later, is_kept):
    """`third` reads no option itself: that no later method takes it is known from the stage it is made of."""
    monkeypatch.setattr("glossbench.shading.stage_cache.MUCH", 0)
    methods = [Chained(x=0.0), *(Chained(x=x) for x in later)]
    cache = StageCache(later=lambda: methods)
    before = prepare(methods.pop(0), INPUTS, cache)

    prepare(methods[0], INPUTS, cache)

    after = prepare(Chained(x=0.0), INPUTS, cache)
    assert [after[name] is before[name] for name in before] == [is_kept] * 3
    assert float(after["third"].value[0]) == 2.0


@pytest.mark.parametrize(("much", "later"), [(MUCH, [Chained(x=1.0)]), (0, None)])
def test_nothing_is_dropped_from_little_memory_or_if_the_later_methods_are_not_known(monkeypatch, much, later):
    monkeypatch.setattr("glossbench.shading.stage_cache.MUCH", much)
    cache = StageCache(later=lambda: later)
    before = prepare(Chained(x=0.0), INPUTS, cache)

    prepare(Chained(x=1.0), INPUTS, cache)

    assert prepare(Chained(x=0.0), INPUTS, cache)["third"] is before["third"]


def test_a_value_that_is_timed_when_memory_is_freed_stays_in_the_cache(monkeypatch):
    monkeypatch.setattr("glossbench.shading.stage_cache.MUCH", 0)
    cache = StageCache(later=lambda: [Chained(x=1.0)])
    cold = prepare(Chained(x=0.0), INPUTS, cache)

    warm = prepare(Chained(x=0.0), INPUTS, cache, patience=1e-6)

    assert warm["first"] is cold["first"]
    assert all(prepare(Chained(x=0.0), INPUTS, cache)[name] is warm[name] for name in warm)
    warm["first"].value.numpy()[0] = 99
    with pytest.raises(MethodError, match="'first'"):
        cache.check("mine")


def test_the_cache_drops_nothing_that_a_running_method_uses():
    cache = StageCache(limit=0)

    prepared = prepare(Chained(x=1.0), INPUTS, cache)
    cache_of_one_turn = [p for entries in cache._entries.values() for _, p in entries]

    assert {id(p) for p in cache_of_one_turn} == {id(p) for p in prepared.values()}


def test_a_stage_that_is_timed_later_keeps_the_value_that_others_are_made_of():
    cache = StageCache()
    cold = prepare(Chained(x=1.0), INPUTS, cache)

    warm = prepare(Chained(x=1.0), INPUTS, cache, patience=1e-6)

    assert all(warm[name].value is cold[name].value and warm[name].warm for name in cold)


def test_a_value_that_is_written_to_through_numpy_breaks_the_check_and_is_made_again():
    cache = StageCache()
    prepare(Chained(x=1.0), INPUTS, cache)["second"].value.numpy()[0] = 99

    with pytest.raises(MethodError, match=r"^mine writes into the memory of 'second', which is also used elsewhere$"):
        cache.check("mine")

    assert third_of(1.0, cache) == 4.0
    assert float(prepare(Chained(x=1.0), INPUTS, cache)["second"].value[0]) == 2.0


def test_a_value_that_is_written_to_later_is_not_handed_out():
    cache = StageCache()
    prepared = prepare(Chained(x=1.0), INPUTS, cache)
    cache.check("mine")
    prepared["third"].value.numpy()[0] = 99

    assert third_of(1.0, cache) == 4.0


def test_the_type_of_an_option_counts_as_well_as_its_value():
    class Whole(Method):
        x: int = 1
        first = vars(Chained)["first"]

        def shade(self, points, first):
            return first

    cache = StageCache()

    assert prepare(Chained(x=1.0), INPUTS, cache)["first"].value.dtype == torch.float32
    assert prepare(Whole(x=1), INPUTS, cache)["first"].value.dtype == torch.int64


@stage
def tone(self, light):
    return torch.full((4,), {"warm": 1.0, "cold": 2.0}[read_option(self, "tone_of", "warm")])


class Plain(Method):
    tone = tone

    def shade(self, points, tone):
        return tone[:3].expand(len(points), 3)


class Toned(Plain):
    tone_of: str = "warm"


def test_a_method_without_an_option_shares_the_stage_of_those_that_have_its_default():
    cache = StageCache()
    values = {
        name: prepare(method, INPUTS, cache)["tone"].value
        for name, method in {"plain": Plain(), "warm": Toned(), "cold": Toned(tone_of="cold")}.items()
    }

    assert values["plain"] is values["warm"]
    assert values["cold"].tolist() == [2.0] * 4
    assert prepare(Plain(), INPUTS, cache)["tone"].value is values["plain"]


def test_a_method_without_an_option_does_not_share_the_stage_of_another_value():
    cache = StageCache()

    cold, plain = (prepare(m, INPUTS, cache)["tone"].value for m in (Toned(tone_of="cold"), Plain()))

    assert (cold[0], plain[0]) == (2.0, 1.0)


class AskedForItsReading(Method):
    """Its options are called as the parts of what records them."""

    values: int = 3
    read: int = 4

    @stage
    def total(self, light):
        return torch.full((4,), float(self.values + self.read))

    def shade(self, points, total):
        return total[:3].expand(len(points), 3)


def test_options_may_be_called_as_the_recorder_calls_its_parts():
    assert prepare(AskedForItsReading(), INPUTS, StageCache())["total"].value[0] == 7
