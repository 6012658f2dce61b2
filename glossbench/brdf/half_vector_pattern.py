"""A fixed pattern of half vectors over a lobe: its widths, and the weight of each half vector."""

import torch

from glossbench.channels import Channels
from glossbench.shapes import Directions, PairDirections, PairValues, Scalar, Values


class HalfVectorPattern:
    """Defines the density D of a pattern of half vectors that is the same at every pixel.

    A lobe that is not a function of the half vector also has such a density; it approximates the density of half
    vectors of its own samples. The default is Beckmann's D. The module lobe defines the letters.

    Attributes:
        widths: of D along t and b: Beckmann slopes m_x, m_y or GGX alpha_x, alpha_y.

    Source: Luksch et al. 2014 section 5.
    """

    widths: tuple[Scalar, Scalar]

    def f(self, wo: Directions, wi: Directions) -> tuple[PairValues, ...]:
        """The lobe's value [1/sr] by channel."""
        raise NotImplementedError

    def viewer(self, wo: PairDirections) -> PairDirections:
        """The viewer in the lobe's own frame, whose z axis is the normal of the pattern: by default wo itself."""
        return wo

    def to_surface(self, wo: Directions, d: Directions) -> Directions:
        """From the lobe's own frame to the local frame: by default both are the same."""
        return d

    def q(self, slope2: PairValues) -> PairValues:
        """Density of the slope relative to its peak, by default exp(-slope2); slope2 as in the method `slope2`."""
        return torch.exp(-slope2)

    def slope_at(self, q: PairValues) -> PairValues:
        """The square root of slope2 for a relative density q, the inverse of `q`: by default sqrt(-log q)."""
        return torch.sqrt(-torch.log(q))

    def slope2(self, h: PairDirections) -> PairValues:
        """(h_x / (w_x h_z))^2 + (h_y / (w_y h_z))^2"""
        x, y = h.x / (self.widths[0] * h.z), h.y / (self.widths[1] * h.z)
        return x * x + y * y

    def D(self, h: PairDirections) -> PairValues:
        """Half vector density q / (pi w_x w_y cos_h^4) [1/sr], integral of D cos_h = 1 over the hemisphere."""
        cos2 = h.z * h.z
        return self.q(self.slope2(h)) / (torch.pi * self.widths[0] * self.widths[1] * cos2 * cos2)

    def f_over_D(self, wo: Directions, wi: Directions, h: Directions, c: Values) -> Channels:
        """f(wo, wi) / D(h) by channel; c = viewer(wo) . h, wi = to_surface(wo, mirror direction of viewer(wo) at h)."""
        D = self.D(h)
        return tuple(f / D for f in self.f(wo, wi))
