"""The contract: every method keeps it, and each check turns red on a method with a planted fault."""

from collections import defaultdict
from dataclasses import replace
from math import pi

import pytest
import torch
from scipy.spatial.transform import Rotation

from glossbench.brdf.kurt import Kurt
from glossbench.brdf.material import Material
from glossbench.contract import method_check as contract
from glossbench.contract.cases import (
    FURNACE_MATERIALS,
    GivenPoints,
    build_general_points,
    build_hard_points,
    build_truth,
    turn,
    turn_light,
)
from glossbench.contract.method_check import (
    CHECKS,
    Outcome,
    as_checked,
    check_chunks,
    check_contract,
    check_converges,
    check_finite,
    check_furnace,
    check_linear,
    check_one_by_one,
    check_pure,
    check_shape,
    check_supports,
    check_turns,
)
from glossbench.directions import Vec3, cross, dot, normalize, spherical, stack
from glossbench.envmap.cubemap import CubeMap, texel_directions
from glossbench.envmap.lights.synthetic import Gradient
from glossbench.errors import InputError
from glossbench.shading.image import shade
from glossbench.shading.method import METHODS, Contract, Method, stage
from glossbench.shading.stage_cache import StageCache

Sound = METHODS.get("importance_sampling")
# Without `image`, whose pixels come from a file and belong to one light, material and view.
OWN = [
    name
    for name in METHODS.names()
    if METHODS.get(name).__module__.startswith("glossbench.methods.") and name != "image"
]


@pytest.fixture(scope="module")
def truth():
    return build_truth(Sound())


@pytest.fixture(scope="module")
def kept():
    """By name of a method, the stages that its checks share, as in `check_contract`."""
    return defaultdict(StageCache)


@pytest.mark.parametrize("check", [c for c in CHECKS if c is not check_converges], ids=lambda c: c.__name__)
@pytest.mark.parametrize("name", OWN)
def test_every_method_keeps(name, check, kept):
    check_kept(as_checked(name), check, kept=kept[name])


@pytest.mark.parametrize("name", OWN)
def test_every_method_converges_as_it_claims(name, truth):
    check_kept(as_checked(name), check_converges, truth=truth)


def check_kept(method, check, **given):
    """A check is kept, or is not judged because the contract does not claim it; nothing else excuses a method."""
    contract = method.contract
    is_claimed = {
        check_linear: contract.linear,
        check_converges: contract.slope is not None and contract.budget is not None,
    }.get(check, True)

    outcome = check(method, **given)

    assert outcome.kept is (True if is_claimed else None), outcome


@pytest.mark.parametrize("check", [check_furnace, check_finite])
def test_a_method_that_supports_no_material_of_a_check_does_not_keep_it(check):
    class Picky(Sound):
        def supports(self, material, scene):
            return "only measured data"

    with pytest.raises(AssertionError, match="kept=None"):
        check_kept(Picky(), check)


# The faults. Each is importance sampling with one error.


def narrowed(material: Material) -> Material:
    option = "m" if isinstance(material, Kurt) else "alpha"
    return replace(material, **{option: tuple(w * w for w in getattr(material, option))})


class AlphaSquared(Sound):
    def shade(self, points, material, texels, irradiance):
        return super().shade(points, narrowed(material), texels, irradiance)


class AddsAConstant(Sound):
    def shade(self, points, material, texels, irradiance):
        return super().shade(points, material, texels, irradiance) + 0.01


class LosesAPercent(Sound):
    def shade(self, points, material, texels, irradiance):
        return 0.99 * super().shade(points, material, texels, irradiance)


class SquareOfTheLight(Sound):
    @stage
    def texels(self, light):
        return Sound.texels.function(self, CubeMap(light.faces.square(), light.key))


class ClampsTheLight(Sound):
    @stage
    def texels(self, light):
        return Sound.texels.function(self, CubeMap(light.faces.clamp(max=20), light.key))


class TangentOfTheWorld(Sound):
    def shade(self, points, material, texels, irradiance):
        t = normalize(Vec3(points.n.z, torch.zeros_like(points.n.x), -points.n.x))
        points = replace(points, t=t, b=cross(points.n, t))
        return super().shade(points, material, texels, irradiance)


class MirroredLight(Sound):
    @stage
    def texels(self, light):
        return Sound.texels.function(self, CubeMap(light.faces.flip(2), light.key))


class IgnoresTheBudget(Sound):
    def shade(self, points, material, texels, irradiance):
        return Sound.shade(Sound(samples=16), points, material, texels, irradiance)


class SaysOneCount(Sound):
    def n_samples(self, material):
        return 16


class StuckOnABias(Sound):
    def shade(self, points, material, texels, irradiance):
        return 1.3 * super().shade(points, material, texels, irradiance)


class DividesByTheLight(Sound):
    def shade(self, points, material, texels, irradiance):
        total = texels.texels.sum()
        return super().shade(points, material, texels, irradiance) * total / total


class DividesByTheGrazingCosine(Sound):
    def shade(self, points, material, texels, irradiance):
        cos_o = torch.where(points.wo_local().z < 1e-3, 0.0, 1.0)
        return super().shade(points, material, texels, irradiance) / cos_o[:, None]


class NotANumberForNarrowLobes(Sound):
    def shade(self, points, material, texels, irradiance):
        image = super().shade(points, material, texels, irradiance)
        width = min(float(w) for w in material.reflectance().lobes[0].widths)
        return image * float("nan") if width < 0.01 else image


class NormalisedByTheBatch(Sound):
    def shade(self, points, material, texels, irradiance):
        image = super().shade(points, material, texels, irradiance)
        return image / image.mean()


class DependsOnThePlaceInTheBatch(Sound):
    def shade(self, points, material, texels, irradiance):
        image = super().shade(points, material, texels, irradiance)
        return image * (1 + 1e-3 * (torch.arange(len(points)) % 2))[:, None]


class RandomPerCall(Sound):
    def shade(self, points, material, texels, irradiance):
        image = super().shade(points, material, texels, irradiance)
        return image * (1 + torch.rand(1))


class RandomPerStage(Sound):
    @stage
    def texels(self, light):
        return Sound.texels.function(self, CubeMap(light.faces * (1 + torch.rand(1)), light.key))


class WritesIntoTheLight(Sound):
    @stage
    def texels(self, light):
        light.faces.clamp_(max=1)
        return Sound.texels.function(self, light)


class WritesIntoThePoints(Sound):
    def shade(self, points, material, texels, irradiance):
        points.wo.x.neg_()
        return super().shade(points, material, texels, irradiance)


class DoublePrecision(Sound):
    def shade(self, points, material, texels, irradiance):
        return super().shade(points, material, texels, irradiance).double()


class OneChannel(Sound):
    def shade(self, points, material, texels, irradiance):
        return super().shade(points, material, texels, irradiance)[:, :1]


class SqueezesASinglePoint(Sound):
    def shade(self, points, material, texels, irradiance):
        return super().shade(points, material, texels, irradiance).squeeze()


class ReturnsAList(Sound):
    def shade(self, points, material, texels, irradiance):
        return super().shade(points, material, texels, irradiance).tolist()


class RefusesWithoutAReason(Sound):
    def supports(self, material, scene):
        return False if material.reflectance().diffuse else None


class RefusesWithAnEmptyReason(Sound):
    def supports(self, material, scene):
        return "" if material.reflectance().diffuse else None


class RefusesByRaising(Sound):
    def supports(self, material, scene):
        raise NotImplementedError("anisotropic\nsecond line")


class CannotShadeWhatItSupports(Sound):
    def shade(self, points, material, texels, irradiance):
        if len(material.reflectance().lobes) > 1:
            raise IndexError("one lobe only")
        return super().shade(points, material, texels, irradiance)


@pytest.mark.parametrize(
    ("check", "fault"),
    [
        (check_furnace, AlphaSquared),
        (check_furnace, AddsAConstant),
        (check_furnace, LosesAPercent),
        (check_linear, SquareOfTheLight),
        (check_linear, ClampsTheLight),
        (check_linear, AddsAConstant),
        (check_turns, TangentOfTheWorld),
        (check_turns, MirroredLight),
        (check_finite, DividesByTheLight),
        (check_finite, AddsAConstant),
        (check_finite, DividesByTheGrazingCosine),
        (check_finite, NotANumberForNarrowLobes),
        (check_chunks, NormalisedByTheBatch),
        (check_chunks, DependsOnThePlaceInTheBatch),
        (check_one_by_one, NormalisedByTheBatch),
        (check_one_by_one, DependsOnThePlaceInTheBatch),
        (check_shape, DoublePrecision),
        (check_shape, OneChannel),
        (check_shape, SqueezesASinglePoint),
        (check_shape, ReturnsAList),
        (check_pure, RandomPerCall),
        (check_pure, RandomPerStage),
        (check_pure, WritesIntoTheLight),
        (check_pure, WritesIntoThePoints),
        (check_supports, RefusesWithoutAReason),
        (check_supports, RefusesWithAnEmptyReason),
        (check_supports, RefusesByRaising),
        (check_supports, CannotShadeWhatItSupports),
    ],
    ids=lambda value: value.__name__,
)
def test_goes_red(check, fault):
    outcome = check(fault())

    assert outcome.kept is False, outcome
    assert "\n" not in outcome.measured


@pytest.mark.parametrize(
    "fault",
    [AlphaSquared, IgnoresTheBudget, SaysOneCount, StuckOnABias, SquareOfTheLight, TangentOfTheWorld],
)
def test_convergence_goes_red(fault, truth):
    outcome = check_converges(fault(), truth=truth)

    assert outcome.kept is False, outcome


def test_the_twin_without_a_fault_is_green_everywhere(truth):
    class Faultless(Sound):
        def shade(self, points, material, texels, irradiance):
            return super().shade(points, material, texels, irradiance)

    outcomes = [c(Faultless(), truth=truth) if c is check_converges else c(Faultless()) for c in CHECKS]

    assert [o.kept for o in outcomes] == [True] * len(CHECKS), outcomes


def test_nan_breaks_the_furnace_whichever_material_gives_it():
    class NotANumberForGGX(Sound):
        def shade(self, points, material, texels, irradiance):
            image = super().shade(points, material, texels, irradiance)
            return image if isinstance(material, Kurt) else image * float("nan")

    outcome = check_furnace(NotANumberForGGX())

    assert outcome.kept is False
    assert outcome.measured.startswith("nan of the mean with ggx")


def test_a_method_that_raises_breaks_the_check_with_one_line():
    class Raises(Sound):
        def shade(self, points, material, texels, irradiance):
            raise ZeroDivisionError("no samples\nand more")

    assert check_linear(Raises()) == Outcome("linear in the light", False, "ZeroDivisionError: no samples")


def test_what_is_not_claimed_is_not_judged(truth):
    class ClaimsLittle(SquareOfTheLight):
        contract = Contract(linear=False)

    assert check_linear(ClaimsLittle()).kept is None
    assert check_converges(ClaimsLittle(), truth=truth).kept is None


def test_a_budget_that_is_not_an_option_breaks_a_claimed_slope(truth):
    class Misspelt(Sound):
        contract = Contract(budget=("sampels", (16, 64)), slope=-0.5)

    outcome = check_converges(Misspelt(), truth=truth)

    assert outcome.kept is False
    assert outcome.measured == "the contract's budget is 'sampels', which is not an option"


def test_a_method_at_the_noise_floor_converges(truth):
    class Knows(Sound):
        def shade(self, points, material, texels, irradiance):
            return truth.reference.radiance[0].float()

    outcome = check_converges(Knows(), truth=truth)

    assert outcome == Outcome("converges", True, "at the noise floor with 16 samples already")


def test_a_method_that_supports_no_material_of_a_check_says_why():
    class Picky(Sound):
        def supports(self, material, scene):
            return "only measured data"

    assert check_furnace(Picky()).kept is None
    assert check_finite(Picky()).kept is None
    assert check_supports(Picky()).measured.endswith("unsupported: only measured data")
    assert check_linear(Picky()).measured.endswith("only measured data")


BUDGET = ("samples", (16, 64, 256, 1024))


def test_the_furnace_and_convergence_use_the_options_of_the_contract(truth):
    class CutOff(Method):
        samples: int = 40
        cut: bool = True
        contract = Contract(furnace=1e-3, budget=BUDGET, slope=-0.5, options={"cut": False})
        texels, irradiance = vars(Sound)["texels"], vars(Sound)["irradiance"]

        def shade(self, points, material, texels, irradiance):
            image = Sound.shade(Sound(samples=self.samples), points, material, texels, irradiance)
            return image / 2 if self.cut else image

    class StaysCutOff(CutOff):
        contract = Contract(furnace=1e-3, budget=BUDGET, slope=-0.5)

    assert check_furnace(CutOff()).kept
    assert check_converges(CutOff(), truth=truth).kept
    assert check_furnace(StaysCutOff()).kept is False
    assert check_converges(StaysCutOff(), truth=truth).kept is False


# The checks' own tools.


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_turn_is_that_of_a_rotation_by_90_degrees(axis):
    about = torch.eye(3, dtype=torch.float64)[axis].numpy()
    rotation = torch.from_numpy(Rotation.from_rotvec(about * pi / 2).as_matrix())
    v = torch.rand(5, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(0))

    turned = stack(turn(Vec3(*v.T), axis))

    assert torch.allclose(turned, v @ rotation.T, atol=1e-15)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_turned_light_shines_from_the_turned_direction(axis):
    about = torch.eye(3, dtype=torch.float64)[axis].numpy()
    rotation = torch.from_numpy(Rotation.from_rotvec(about * pi / 2).as_matrix()).float()
    d = stack(texel_directions(8))

    turned = turn_light(Gradient(resolution=8).cubemap(), axis).faces

    # L_c(d) = (1 + d_c) / 2 of the direction before the turn, R^-1 d; rounding of float32 directions, 6e-8.
    assert torch.allclose(turned, (1 + d @ rotation) / 2, atol=1e-6)
    assert not torch.allclose(turned, (1 + d @ rotation.T) / 2, atol=0.1)


@pytest.mark.parametrize("points", [build_general_points(), build_hard_points()], ids=["general", "hard"])
def test_points_have_right_handed_frames_and_viewers_above(points):
    t, b, n, wo = points.t, points.b, points.n, points.wo

    lengths = torch.stack([dot(v, v) for v in (t, b, n, wo)])
    angles = torch.stack([dot(t, b), dot(t, n), dot(b, n)])

    # Rounding to float32: 2e-7.
    assert torch.allclose(lengths, torch.ones(()), atol=1e-6)
    assert angles.abs().max() < 1e-6
    assert torch.allclose(stack(cross(n, t)), stack(b), atol=1e-6)
    assert (dot(n, wo) > 5e-5).all()


def test_hard_points_look_along_every_axis_edge_and_corner_and_graze():
    points = build_hard_points()

    assert len(points) == 3 * 26
    assert (dot(points.n, points.wo) < 2e-4).sum() == 26
    assert (dot(points.n, points.wo) > 0.9999).sum() == 26


@pytest.mark.parametrize("material", FURNACE_MATERIALS, ids=str)
def test_the_albedo_of_the_furnace_is_the_midpoint_integral_of_the_material(material):
    cos_o = torch.tensor([1.0, 0.6, 0.3], dtype=torch.float64)
    wo = spherical(torch.acos(cos_o), torch.tensor([0.0, 0.5, 2.0], dtype=torch.float64))

    albedo = material.albedo(Vec3(*(c.float() for c in wo)))

    n_theta, n_phi = 400, 800
    cos_i = (torch.arange(n_theta, dtype=torch.float64) + 0.5) / n_theta
    phi = (torch.arange(n_phi, dtype=torch.float64) + 0.5) / n_phi * 2 * pi
    theta, phi = (g.reshape(1, -1) for g in torch.meshgrid(torch.acos(cos_i), phi, indexing="ij"))
    wi = spherical(theta, phi)
    f = material.f(Vec3(*(c[:, None] for c in wo)), wi)
    integral = torch.stack([(c * wi.z).mean(1) * 2 * pi for c in (f if len(f) == 3 else f * 3)], dim=1)
    # Measured 4e-4, the 4096 points of the albedo; the furnace's own bounds begin at 1e-3 of the mean.
    assert torch.allclose(albedo, integral, rtol=8e-4, atol=0)


def test_given_points_are_a_view_of_one_row():
    points = build_general_points(7)

    image = shade(Sound(samples=4), Gradient(resolution=8).cubemap(), Kurt(), GivenPoints(points), time_it=False)

    assert image.radiance.shape == (1, 7, 3)
    assert GivenPoints(points) != GivenPoints(points)


# The names that `check-method` takes.


@pytest.fixture
def module(tmp_path, monkeypatch):
    """Writes an importable module; what it registers is forgotten after the test."""
    monkeypatch.syspath_prepend(tmp_path)

    def write(name, code):
        (tmp_path / f"{name}.py").write_text(code)
        return name

    with METHODS.isolated():
        yield write


@pytest.fixture
def one_check(monkeypatch):
    monkeypatch.setattr(contract, "CHECKS", (check_shape,))


BLACK = """
import torch
from glossbench.shading.method import METHODS, Method

@METHODS.register("{name}")
class Black(Method):
    def shade(self, points, material):
        return torch.zeros(len(points), 3)
"""


def test_a_registered_name_is_checked(one_check):
    assert check_contract("importance_sampling") == [Outcome("shape and type", True, "(P, 3) float32")]


def test_a_module_is_imported_and_its_method_checked(module, one_check):
    name = module("contract_test_black", BLACK.format(name="black"))

    assert check_contract(name) == [Outcome("shape and type", True, "(P, 3) float32")]
    assert check_contract("black") == check_contract(name)


def test_both_methods_of_a_module_are_checked_by_name(module, one_check):
    code = BLACK.format(name="black") + BLACK.replace("Black", "Night").format(name="night")

    outcomes = check_contract(module("contract_test_two", code))

    assert [o.check for o in outcomes] == ["black: shape and type", "night: shape and type"]


def test_all_checks_run_on_a_method_without_options_and_black_is_broken(module):
    outcomes = check_contract(module("contract_test_dark", BLACK.format(name="dark")))

    assert len(outcomes) == len(CHECKS)
    assert {o.check: o.kept for o in outcomes if o.kept is not True} == {
        "furnace": False,
        "converges": None,
    }


@pytest.mark.parametrize(
    ("name", "code", "message"),
    [
        (
            "importance_samplin",
            None,
            r"^'importance_samplin' is neither a method nor a module; did you mean",
        ),
        (
            "unheard_of",
            None,
            r"^'unheard_of' is neither a method nor a module: no such module: not in /.*, nor installed$",
        ),
        ("json", None, "^module 'json' registers no method$"),
        (
            "contract_test_broken",
            "1 / 0",
            "^module 'contract_test_broken': ZeroDivisionError: division by zero$",
        ),
        ("contract_test_needs", "import no_such_thing", "^module 'contract_test_needs': ModuleNotFoundError"),
        (
            "contract_test_width",
            BLACK.format(name="wide").replace("    def", "    width: float\n\n    def"),
            "'width' is required",
        ),
    ],
)
def test_a_name_that_cannot_be_checked_is_one_line(name, code, message, module):
    if code is not None:
        module(name, code)

    with pytest.raises(InputError, match=message):
        check_contract(name)


def test_a_failed_check_names_file_and_line_of_the_plug_in_and_each_check_is_reported(tmp_path, monkeypatch):
    code = "from glossbench.shading.method import METHODS, Method\n@METHODS.register('breaks_here')\nclass B(Method):\n"
    (tmp_path / "breaks_here_plugin.py").write_text(code + "    def shade(self, points):\n        raise KeyError(7)\n")
    monkeypatch.syspath_prepend(tmp_path)
    doing = []

    [furnace, *others] = check_contract("breaks_here_plugin", doing.append)

    assert (furnace.measured, furnace.where) == ("KeyError: 7", f"{tmp_path}/breaks_here_plugin.py:5")
    assert doing[0] == "breaks_here: furnace"
    assert len(doing) == 1 + len(others)
