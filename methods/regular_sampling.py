"""Regular sampling, Luksch et al. 2014: half vectors on concentric circles that read a filtered light."""

from math import atan, cos, floor, log2, pi, radians, sin
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import torch
from pydantic import Field
from torch import Tensor

from glossbench.prefilter import (
    METHODS,
    Contract,
    Finite,
    InputError,
    Lobe,
    Material,
    Method,
    MipFilter,
    Occluder,
    Pyramid,
    Radiance,
    ShadingPoints,
    Vec3,
    dot,
    irradiance,
    kernel,
    occluder_of,
    over_points,
    points_2d,
    pyramid,
    reflect,
    spherical,
    stage,
    to_world,
    unhidden,
    visible_diffuse,
    weighted_radiance,
)

Spacing = Literal["s1", "s2"]


class Pattern(NamedTuple):
    """The samples of one lobe: the same half vectors at every pixel.

    Attributes:
        h: half vectors, components (1, N).
        factor: 4 D(h_i) / (N p_h), (1, N): the factor of eq. 9, 17 and 18 that depends only on the sample.
        u, v: extreme half vectors along t and b, on the border xi.
    """

    h: Vec3
    factor: Tensor
    u: Vec3
    v: Vec3


@METHODS.register("regular_sampling")
class RegularSampling(Method):
    """Lo ~ (1/N) sum of L(wi, l) f cos_i 4 (h_i . wi) / p_h, the h_i on circles about the normal.

    l = log4(A R^2 / (4 N) / (major (wi . h))) + mip_bias: the lobe's elliptical cross section A at unit distance,
    divided among the samples. p_h is the mean of D over the pattern, so the estimate normalises itself: it is right on
    average for small m, and biased where cos_i / cos_h is far from 1 and by the truncation of the lobe at xi. The
    pattern becomes visible if lights are smaller than its spacing.

    Attributes:
        samples: the budget; the pattern of either spacing whose number of samples is nearest to it is used.
        xi: density, over its peak, at which the lobe is cut off.
        n_circles: number of circles; together with `spacing` it states a pattern, instead of the budget.
        spacing: s1 begins with one sample at the centre and six around it, s2 with four around the centre.
        normalisation: "printed", p_h = mean of D(h_i), eq. 18; "exact", p_h = mean of D(h_i) cos(theta_i), with which
            the integral of D over projected solid angle is 1, as the definition of D requires.
        mip_bias: number of levels to add to l.
        mip_filter: filter of the pyramid.
        visibility: "rays": one shadow ray per sample if the scene hides light; the diffuse part then takes as many
            filtered samples as the budget, of density cos_i / pi.

    Source: Luksch et al. 2014 eq. 11 to 18. Differs: the constants of eq. 12 (see `sample_pattern`); the angles of
    eq. 14 are limited to 85 degrees, below the pole of eq. 15; a lobe other than Beckmann's is cut where its own slope
    density falls to xi; the pattern of a cosine lobe is centred on its axis.
    """

    samples: Annotated[int, Field(ge=1, le=1 << 16)] = 40
    xi: Annotated[float, Field(gt=0, lt=1)] = 0.2
    n_circles: Annotated[int, Field(ge=1, le=256)] | None = None
    spacing: Spacing | None = None
    normalisation: Literal["printed", "exact"] = "printed"
    mip_bias: Annotated[Finite, Field(ge=-4, le=4)] = 0.0
    mip_filter: MipFilter = "gauss6"
    visibility: Literal["none", "rays"] = "none"

    # Measured: furnace 0.053 with GGX, whose tail is lost by the cut at xi, 3e-4 with Beckmann lobes; slope -0.72. With
    # the defaults furnace is 0.21 and 0.014, and under spots more samples do not help: the error stays at 0.1.
    equation = "L_o approx 1/N sum_(i=1)^N L(omega_i, l) thin f cos theta_i (4 (h_i dot omega_i))/p_h"
    contract: ClassVar[Contract] = Contract(
        furnace=0.08, budget=("samples", (16, 64, 256, 1024)), slope=-0.5,
        options={"xi": 0.001, "normalisation": "exact"},
    )  # fmt: skip

    pyramid = pyramid
    irradiance = irradiance

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.n_circles is None) != (self.spacing is None):
            raise InputError("regular_sampling.n_circles and regular_sampling.spacing go together, got one of them")

    def n_samples(self, material: Material) -> int:
        """Number of samples in the patterns of all lobes."""
        return sum(len(angles) for angles in self._find_angles(material))

    def notes(self) -> tuple[str, ...]:
        """A note that the cut at xi limits the accuracy of a large budget."""
        if self.n_circles is not None or self.samples < 30 or self.xi < 0.1:
            return ()
        return (
            f"regular_sampling: xi {self.xi:g} cuts off the tail of each lobe, and more samples do not bring it back; "
            "use a smaller xi for a larger budget (quickstart: 0.05 at 61, 0.01 at 252)",
        )

    def half_vectors(self, material: Material) -> Tensor | None:
        """The first lobe's pattern."""
        return next(iter(self._find_angles(material)), None)

    @stage
    def patterns(self, material: Material) -> tuple[Pattern, ...]:
        """The pattern of each lobe."""
        lobes = material.as_lobes().lobes
        return tuple(
            self._make_pattern(lobe, angles) for lobe, angles in zip(lobes, self._find_angles(material), strict=True)
        )

    def _find_angles(self, material: Material) -> list[Tensor]:
        reflectance = material.as_lobes()
        if self.n_circles is None or self.spacing is None:
            budgets = reflectance.share(self.samples)
            return [_choose_nearest(lobe, self.xi, n) for lobe, n in zip(reflectance.lobes, budgets, strict=True)]
        return [_place_circles(lobe, self.xi, self.n_circles, self.spacing) for lobe in reflectance.lobes]

    def _make_pattern(self, lobe: Lobe, angles: Tensor) -> Pattern:
        h = Vec3(*(c[None] for c in spherical(angles[:, 0], angles[:, 1])))
        D = lobe.D(h)
        p_h = (D if self.normalisation == "printed" else D * h.z).mean()
        radius = lobe.slope_at(torch.tensor(self.xi))
        zero = torch.zeros(())
        theta_u, theta_v = torch.atan(radius * lobe.widths[0]), torch.atan(radius * lobe.widths[1])
        u = Vec3(torch.sin(theta_u), zero, torch.cos(theta_u))
        v = Vec3(zero, torch.sin(theta_v), torch.cos(theta_v))
        return Pattern(h, 4 * D / (len(angles) * p_h), u, v)

    def shade(
        self,
        points: ShadingPoints,
        material: Material,
        patterns: tuple[Pattern, ...],
        pyramid: Pyramid,
        irradiance: Tensor,
        scene: Any = None,
    ) -> Radiance:
        """Radiance (P, 3)."""
        reflectance = material.as_lobes(points.device)
        bias = torch.tensor(self.mip_bias, device=points.device)
        occluder = occluder_of(scene) if self.visibility == "rays" else None
        u = points_2d(self.samples).to(points.device)
        level = bias - log2(self.samples) / 2
        radiance = visible_diffuse(points, reflectance, irradiance, occluder, pyramid, u, level)
        for lobe, pattern in zip(reflectance.lobes, patterns, strict=True):
            n = pattern.factor.shape[1]
            arguments = (lobe, _move_to(pattern, points.device), pyramid, bias, occluder)
            radiance += over_points(_kernel, points, n, *arguments)
        return radiance


def _move_to(pattern: Pattern, device: str) -> Pattern:
    vectors = [Vec3(*(c.to(device) for c in v)) for v in (pattern.h, pattern.u, pattern.v)]
    return Pattern(vectors[0], pattern.factor.to(device), vectors[1], vectors[2])


@kernel("regular_sampling")
def _kernel(
    points: ShadingPoints, lobe: Lobe, pattern: Pattern, pyramid: Pyramid, bias: Tensor, occluder: Occluder | None
) -> Radiance:
    """Sum over the pattern of one lobe."""
    wo, h = points.wo_local(), pattern.h
    viewer = lobe.viewer(wo)
    wi = lobe.to_surface(wo, reflect(viewer, h))
    visible = (wi.z > 0) & (dot(viewer, h) > 0)
    c = dot(viewer, h).clamp(min=1e-4)
    measure = c * wi.z * pattern.factor
    weight = tuple(torch.where(visible, f * measure, 0.0) for f in lobe.f_over_D(wo, wi, h, c))
    d = to_world(wi, points.t, points.b, points.n)
    major = torch.maximum(torch.maximum(d.x.abs(), d.y.abs()), d.z.abs())
    texels = pyramid.sizes[0] ** 2 / (4 * pattern.factor.shape[1])
    lod = 0.5 * torch.log2(lobe_area(viewer, pattern.u, pattern.v) * texels / (major * c)) + bias
    return weighted_radiance(pyramid, d, lod.clamp(min=0), unhidden(weight, points, d, occluder))


def lobe_area(wo: Vec3, u: Vec3, v: Vec3) -> Tensor:
    """A = pi tan(alpha_U) tan(alpha_V): area of the lobe's cross section at unit distance, eq. 14 and 15.

    alpha is the angle from the mirror direction to the reflection at an extreme half vector. It is limited to 85
    degrees: at pi/2 the tangent has a pole, and beyond it is negative. alpha is computed from the chord e between both
    directions, cos = 1 - e^2 / 2: in float32 a cosine near 1 is not precise enough for small lobes and grazing views.
    """
    centre = Vec3(-wo.x, -wo.y, wo.z)
    ends = (reflect(wo, edge) for edge in (u, v))
    chords = (Vec3(e.x - centre.x, e.y - centre.y, e.z - centre.z) for e in ends)
    squares = [dot(e, e).clamp(1e-12, 2 - 2 * cos(radians(85))) for e in chords]
    tangents = [torch.sqrt(e2 * (1 - e2 / 4)) / (1 - e2 / 2) for e2 in squares]
    return pi * tangents[0] * tangents[1]


def sample_pattern(m_x: float, m_y: float, xi: float, n_circles: int, spacing: Spacing) -> Tensor:
    """Angles theta_h, phi_h (N, 2) of the half vectors for a Beckmann lobe with slopes m_x, m_y.

    theta_max = atan(sqrt(-log xi) max(m_x, m_y)), eq. 11. Circles i = 0 .. n_circles - 1 lie at theta_i = i s for s1,
    whose circle 0 is one sample, and (i + 2/3) s for s2; s puts the outer border, half a spacing beyond the last
    circle, at theta_max. Circle i has 2 floor(n_0 sin(theta_i) / (2 sin(theta_0)) + 1/2) samples, eq. 13, n_0 = 6 (s1)
    or 4 (s2) on the first circle of more than one. Samples with q < xi are rejected. Each circle is also tried turned
    by half a sample; the one whose remaining samples have the larger sum of q is used.

    Source: Luksch et al. 2014 section 5. Differs: the spacings of eq. 12 as printed do not give the numbers of samples
    in the paper's figures; s = theta_max / (n_c - 1/2) and theta_max / (n_c + 1/6) give all of them (19 and 30,
    figure 4).
    """
    check = RegularSampling(xi=xi, n_circles=n_circles, spacing=spacing)
    if not (0 < m_x <= 1 and 0 < m_y <= 1):
        raise InputError(f"sample_pattern: m_x and m_y must be in (0, 1], got {m_x!r} and {m_y!r}")
    return _place_circles(Lobe((torch.tensor(m_x), torch.tensor(m_y)), ks=()), check.xi, n_circles, spacing)


def _place_circles(lobe: Lobe, xi: float, n_circles: int, spacing: Spacing) -> Tensor:
    """`sample_pattern` for any lobe, by its own slope density q."""
    w_x, w_y = (w.double().cpu() for w in lobe.widths)
    radius = lobe.slope_at(torch.tensor(xi, dtype=torch.float64))
    theta_max = atan(float(radius * torch.maximum(w_x, w_y)))
    s = theta_max / (n_circles - 1 / 2 if spacing == "s1" else n_circles + 1 / 6)
    thetas = [(i if spacing == "s1" else i + 2 / 3) * s for i in range(n_circles)]
    n_first, theta_first = (6, s) if spacing == "s1" else (4, thetas[0])
    counts = [1 if t == 0 else 2 * floor(n_first * sin(t) / (2 * sin(theta_first)) + 1 / 2) for t in thetas]
    # One row for each turn, all circles beside each other.
    n = torch.tensor(counts)
    circle = torch.arange(n_circles).repeat_interleave(n)
    place = torch.arange(len(circle)) - (n.cumsum(0) - n)[circle]
    phi = 2 * pi * (place + torch.tensor([[0.0], [0.5]], dtype=torch.float64)) / n[circle]
    theta = torch.tensor(thetas, dtype=torch.float64)[circle].expand_as(phi)
    h = spherical(theta, phi)
    slope2 = (h.x / (w_x * h.z)) ** 2 + (h.y / (w_y * h.z)) ** 2
    is_kept = slope2 <= radius * radius
    q = torch.where(is_kept, lobe.q(slope2), 0.0)
    unturned, turned = torch.zeros(2, n_circles, dtype=torch.float64).index_add_(1, circle, q)
    # For an isotropic lobe both circles have the same sum except for rounding: the unturned one is used.
    best = (turned > unturned * (1 + 1e-9)).long()[circle]
    samples = torch.arange(len(circle))
    return torch.stack([theta, phi], dim=-1)[best, samples][is_kept[best, samples]].float()


def _choose_nearest(lobe: Lobe, xi: float, budget: int) -> Tensor:
    """Among the patterns of both spacings, the one whose count is nearest to a budget; if equal, with fewer circles."""
    best = torch.empty(0, 2)
    n_circles, beyond = 0, False
    while not beyond and n_circles < 256:
        n_circles += 1
        both = [_place_circles(lobe, xi, n_circles, spacing) for spacing in ("s1", "s2")]
        for angles in both:
            if len(angles) and (not len(best) or abs(len(angles) - budget) < abs(len(best) - budget)):
                best = angles
        # The margin is needed because, with rejection, the counts do not grow evenly with the circles.
        beyond = min(len(angles) for angles in both) > 1.5 * budget + 8
    return best
