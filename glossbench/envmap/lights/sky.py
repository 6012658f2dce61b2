"""A clear sky with its sun, defined by formulas: the outdoor light with the widest dynamic range."""

from math import cos, exp, pi, radians, sin, sqrt, tan
from typing import Annotated

import torch
from pydantic import Field
from torch import Tensor

from glossbench.directions import Vec3, stack, vec3
from glossbench.envmap.cubemap import CubeMap, face_coordinates, texel_directions, texel_solid_angles
from glossbench.envmap.lights.light import LIGHTS, Light
from glossbench.envmap.lights.placing import build_frame
from glossbench.options import Color, Finite, NonNegative, Resolution

SUN_RADIUS = radians(0.533 / 2)
SUN_SOLID_ANGLE = 4 * pi * sin(SUN_RADIUS / 2) ** 2
_SUN_POINTS = 2**18  # 240 per texel if a face has 8192 texels along its edge

# XYZ -> linear Rec. 709, IEC 61966-2-1.
_RGB = torch.tensor([[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]])

# Perez's A to E of the luminance Y and the chromaticities x and y, each (slope, offset) in turbidity.
_PEREZ = (
    ((0.1787, -1.4630), (-0.3554, 0.4275), (-0.0227, 5.3251), (0.1206, -2.5771), (-0.0670, 0.3703)),
    ((-0.0193, -0.2592), (-0.0665, 0.0008), (-0.0004, 0.2125), (-0.0641, -0.8989), (-0.0033, 0.0452)),
    ((-0.0167, -0.2608), (-0.0950, 0.0092), (-0.0079, 0.2102), (-0.0441, -1.6537), (-0.0109, 0.0529)),
)
# Zenith chromaticities x and y: rows T^2, T, 1; columns theta^3, theta^2, theta, 1.
_ZENITH = (
    ((0.00166, -0.00375, 0.00209, 0), (-0.02903, 0.06377, -0.03202, 0.00394), (0.11693, -0.21196, 0.06052, 0.25886)),
    ((0.00275, -0.00610, 0.00317, 0), (-0.04214, 0.08970, -0.04153, 0.00516), (0.15346, -0.26756, 0.06670, 0.26688)),
)

# Table 2 of the paper, from 380 nm in steps of 10 nm: radiance of the sun outside the atmosphere [100 W / (m2 nm sr)]
# and absorption of ozone [1/m].
_SOLAR = (
    165.5, 162.3, 211.2, 258.8, 258.2, 242.3, 267.6, 296.6, 305.4, 300.6, 306.6, 288.3, 287.1, 278.2, 271.0, 272.3,
    263.6, 255.0, 250.6, 253.1, 253.5, 251.3, 246.3, 241.7, 236.8, 232.1, 228.2, 223.4, 219.7, 215.3, 211.0, 207.3,
    202.4, 198.7, 194.3, 190.7, 186.3, 182.6,
)  # fmt: skip
_OZONE = (
    0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.3, 0.6, 0.9, 1.4, 2.1, 3.0, 4.0, 4.8, 6.3, 7.5, 8.5, 10.3, 12.0, 12.0, 11.5,
    12.5, 12.0, 10.5, 9.0, 7.9, 6.7, 5.7, 4.8, 3.6, 2.8, 2.3, 1.8, 1.4, 1.1, 1.0, 0.9,
)  # fmt: skip
# CIE 1931 colour matching as lobes (height, centre, 1 / width below and above it): Wyman et al. 2013, Listing 1.
_MATCHING = (
    ((0.362, 442.0, 0.0624, 0.0374), (1.056, 599.8, 0.0264, 0.0323), (-0.065, 501.1, 0.0490, 0.0382)),
    ((0.821, 568.8, 0.0213, 0.0247), (0.286, 530.9, 0.0613, 0.0322)),
    ((1.217, 437.0, 0.0845, 0.0278), (0.681, 459.0, 0.0385, 0.0725)),
)


@LIGHTS.register("sky")
class Sky(Light):
    """Clear sky, sun and ground; the luminance 0.2126 R + 0.7152 G + 0.0722 B is in kcd/m2, times `scale`.

    Sky: each of Y, x and y is zenith F(theta, gamma) / F(0, theta_s), with
    F(theta, gamma) = (1 + A exp(B / cos theta)) (1 + C exp(D gamma) + E cos^2 gamma); theta is the angle from the
    zenith, gamma from the sun, theta_s the sun's theta. Sun: a uniform disc of diameter 0.533 degrees, about 1e5 times
    as bright as the sky; the texels that it touches together hold its exact energy at every resolution. Ground:
    everything below the horizon, a diffuse plane of albedo `ground` lit by the sky and the sun.

    Negative channels, of colours outside Rec. 709, are set to zero. This concerns the blue of a sun below 2 degrees
    (turbidity 2) to 9 degrees (turbidity 10) and, if the sun is on the horizon and turbidity is at most 3, up to 5 of
    10,000 directions of the sky.

    The sky of the paper is too bright: with the sun in the zenith, sky and sun together give 1.01 (turbidity 2) to 1.26
    (turbidity 10) times the light that reaches the atmosphere. The sky alone gives 1.6 times the diffuse light of the
    IES clear sky (turbidity 2, elevation 60).

    Attributes:
        elevation: angle of the sun above the horizon [degrees].
        azimuth: angle of the sun from forward (-z) to the right (+x) [degrees]; the default is behind the camera.
        turbidity: haze, from 2 (very clear) to 10 (hazy).
        sun: factor on the radiance of the sun; 0 removes the sun.
        ground: albedo of the ground, a scalar or RGB.
        scale: factor on all radiance.
        resolution: texels along the edge of a face, a power of two.

    Source: Preetham et al. 1999, appendices 1 and 2; weaknesses in Zotti et al. 2007. Differs: the absorption bands of
    water vapour and oxygen are left out; they begin at 690 nm, where the eye hardly sees.
    """

    elevation: Annotated[float, Field(ge=0, le=90)] = 40.0
    azimuth: Finite = 135.0
    turbidity: Annotated[float, Field(ge=2, le=10)] = 3.0
    sun: NonNegative = 1.0
    ground: Color = (0.2, 0.2, 0.2)
    scale: NonNegative = 1.0
    resolution: Resolution = 1024

    def cubemap(self) -> CubeMap:
        """The radiance itself."""
        r = self.resolution
        d = stack(texel_directions(r))
        above = d[..., 1] > 0  # the horizon coincides with edges of texels
        up = d[above]
        weight = texel_solid_angles(r).expand(6, r, r)[above]
        sky = sky_radiance(vec3(up), self.elevation, self.azimuth, self.turbidity)
        sun = self.sun * sun_radiance(self.elevation, self.turbidity)
        disc = _place_sun_disc(self.elevation, self.azimuth)
        irradiance = ((weight * up[:, 1])[:, None] * sky).sum(0) + SUN_SOLID_ANGLE / _SUN_POINTS * disc.y.sum() * sun
        faces = (torch.tensor(self.ground) * irradiance.float() / pi).repeat(6, r, r, 1)
        faces[above] = sky
        _add_sun(faces, disc, sun)
        return CubeMap(self.scale * faces, self.key())


def sky_radiance(d: Vec3, elevation: float, azimuth: float, turbidity: float) -> Tensor:
    """Linear Rec. 709 radiance (P, 3) of the clear sky [kcd/m2] in P directions above the horizon; angles in degrees.

    Source: Preetham et al. 1999 appendix 2.
    """
    theta_s = radians(90 - elevation)
    chi = (4 / 9 - turbidity / 120) * (pi - 2 * theta_s)
    zenith = [(4.0453 * turbidity - 4.9710) * tan(chi) - 0.2155 * turbidity + 2.4192]
    for rows in _ZENITH:
        polynomials = [sum(c * theta_s**k for c, k in zip(row, (3, 2, 1, 0), strict=True)) for row in rows]
        zenith.append((polynomials[0] * turbidity + polynomials[1]) * turbidity + polynomials[2])
    sun = build_frame(azimuth, elevation)[0].tolist()
    # 2 asin(chord / 2) is exact for small angles, where acos is not.
    chord = torch.sqrt((d.x - sun[0]) ** 2 + (d.y - sun[1]) ** 2 + (d.z - sun[2]) ** 2)
    gamma = 2 * torch.asin((chord / 2).clamp(max=1))
    cos2 = torch.cos(gamma) ** 2
    values = []
    for at_zenith, coefficients in zip(zenith, _PEREZ, strict=True):
        A, B, C, D, E = (slope * turbidity + offset for slope, offset in coefficients)
        reference = (1 + A * exp(B)) * (1 + C * exp(D * theta_s) + E * cos(theta_s) ** 2)
        relative = (1 + A * torch.exp(B / d.y)) * (1 + C * torch.exp(D * gamma) + E * cos2)
        values.append(at_zenith / reference * relative)
    luminance, x, y = values
    return (torch.stack([x / y, torch.ones_like(y), (1 - x - y) / y], 1) * luminance[:, None] @ _RGB.T).clamp(min=0)


def sun_radiance(elevation: float, turbidity: float) -> Tensor:
    """Linear Rec. 709 radiance (3,) of the sun's disc seen through the atmosphere [kcd/m2], float64.

    solar radiance * exp(-m (0.008735 l^-4.08 + beta l^-1.3 + 0.0035 k_ozone)): Rayleigh scattering, aerosol and 3.5 mm
    of ozone along the optical mass m, which follows from the elevation [degrees]; l is the wavelength in micrometres.
    683 lm/W and the CIE 1931 observer convert the spectrum to a colour.

    Source: Preetham et al. 1999 appendix 1.
    """
    mass = 1 / (sin(radians(elevation)) + 0.15 * (3.885 + elevation) ** -1.253)
    nm = torch.arange(380, 751, 10, dtype=torch.float64)
    beta = 0.04608 * turbidity - 0.04586
    ozone = 0.0035 * torch.tensor(_OZONE, dtype=torch.float64)
    depth = 0.008735 * (nm / 1000) ** -4.08 + beta * (nm / 1000) ** -1.3 + ozone
    spectrum = 100 * torch.tensor(_SOLAR, dtype=torch.float64) * torch.exp(-mass * depth)
    xyz = torch.stack([0.683 * 10 * (_match_colours(nm, lobes) * spectrum).sum() for lobes in _MATCHING])
    return (_RGB.double() @ xyz).clamp(min=0)


def _match_colours(nm: Tensor, lobes: tuple[tuple[float, float, float, float], ...]) -> Tensor:
    terms = [h * torch.exp(-(((nm - c) * torch.where(nm < c, lo, hi)) ** 2) / 2) for h, c, lo, hi in lobes]
    return torch.stack(terms).sum(0)


def _place_sun_disc(elevation: float, azimuth: float) -> Vec3:
    """Points of the disc above the horizon, on a sunflower spiral; all have an equal share of its solid angle."""
    i = torch.arange(_SUN_POINTS, dtype=torch.float64) + 0.5
    radius = 2 * torch.asin(torch.sqrt(i / _SUN_POINTS) * sin(SUN_RADIUS / 2))
    turn = pi * (3 - sqrt(5)) * i
    local = Vec3(torch.cos(radius), torch.sin(radius) * torch.cos(turn), torch.sin(radius) * torch.sin(turn))
    p = stack(local) @ build_frame(azimuth, elevation)
    return vec3(p[p[:, 1] > 0])


def _add_sun(faces: Tensor, disc: Vec3, radiance: Tensor) -> None:
    """Adds the energy of the disc to the faces (6, R, R, 3); each point adds its share to the texel that it hits."""
    r = faces.shape[1]
    face, s, t, _ = face_coordinates(disc)
    column, row = (((c + 1) * r / 2).long().clamp(max=r - 1) for c in (s, t))
    texel, points = ((face.long() * r + row) * r + column).unique(return_counts=True)
    share = points * (SUN_SOLID_ANGLE / _SUN_POINTS) / texel_solid_angles(r).flatten()[texel % (r * r)]
    faces.view(-1, 3)[texel] += (share[:, None] * radiance).float()
