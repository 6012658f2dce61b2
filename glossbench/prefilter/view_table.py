"""A quantity of a lobe over the angle of the view, as a table."""

from collections.abc import Callable
from dataclasses import dataclass
from math import pi

import torch
from torch import Tensor

from glossbench.brdf.lobe import Lobe
from glossbench.directions import Vec3, spherical
from glossbench.shapes import PointDirections

VIEWS = 64
AZIMUTHS = 4  # over a quarter of the circle; for an anisotropic lobe the table holds their mean


@dataclass(frozen=True)
class ViewTable:
    """Entries at cos_o = ((i + 1) / 64)^2: denser where the view is grazing, and albedos change.

    Attributes:
        values: (64, K), float32.
    """

    values: Tensor

    def at(self, cos_o: Tensor) -> Tensor:
        """The values (P, K) at cosines (P,), linear in sqrt(cos_o) between the entries."""
        place = (torch.sqrt(cos_o.clamp(0, 1)) * VIEWS - 1).clamp(0, VIEWS - 1)
        lower = place.long().clamp(max=VIEWS - 2)
        return torch.lerp(self.values[lower], self.values[lower + 1], (place - lower)[:, None])


def tabulate(lobe: Lobe, function: Callable[[PointDirections], Tensor]) -> ViewTable:
    """The table of a function that gives values (P, K) for views (P,) of a lobe."""
    n = 1 if bool(lobe.widths[0] == lobe.widths[1]) else AZIMUTHS
    theta = torch.acos(((torch.arange(VIEWS) + 1) / VIEWS) ** 2).repeat_interleave(n)
    phi = ((torch.arange(n) + 0.5) / n * (pi / 2)).repeat(VIEWS)
    wo = Vec3(*(c.to(lobe.ks[0].device) for c in spherical(theta, phi)))
    return ViewTable(function(wo).view(VIEWS, n, -1).mean(1).float())
