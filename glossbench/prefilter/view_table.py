"""A quantity of a lobe over the direction of the view, as a table."""

from collections.abc import Callable
from dataclasses import dataclass
from math import pi

import torch
from torch import Tensor

from glossbench.brdf.lobe import Lobe
from glossbench.directions import Vec3, spherical
from glossbench.shapes import PointDirections

VIEWS, AZIMUTHS = 64, 9


@dataclass(frozen=True)
class ViewTable:
    """Entries at cos_o = ((i + 1) / 64)^2, denser where the view is grazing and albedos change, and azimuths j pi / 16.

    A quarter of all azimuths is enough: lobes are symmetric about t and b.

    Attributes:
        values: (64, A, K), float32; A is 1 for an isotropic lobe, else 9.
    """

    values: Tensor

    def at(self, wo: PointDirections) -> Tensor:
        """The values (P, K) at views in the local frame, linear in sqrt(cos_o) and in the azimuth between entries."""
        values = self.values.to(wo.z.device)
        place = (torch.sqrt(wo.z.clamp(0, 1)) * VIEWS - 1).clamp(0, VIEWS - 1)
        i = place.long().clamp(max=VIEWS - 2)
        part = (place - i)[:, None]
        if values.shape[1] == 1:
            return torch.lerp(values[i, 0], values[i + 1, 0], part)
        turn = torch.atan2(wo.y.abs(), wo.x.abs()) * ((AZIMUTHS - 1) / (pi / 2))
        j = turn.long().clamp(max=AZIMUTHS - 2)
        turn = (turn - j)[:, None]
        low, high = (torch.lerp(values[k, j], values[k, j + 1], turn) for k in (i, i + 1))
        return torch.lerp(low, high, part)


def tabulate(lobe: Lobe, function: Callable[[PointDirections], Tensor]) -> ViewTable:
    """The table of a function that gives values (P, K) for views (P,) of a lobe."""
    n = 1 if bool(lobe.widths[0] == lobe.widths[1]) else AZIMUTHS
    theta = torch.acos(((torch.arange(VIEWS) + 1) / VIEWS) ** 2).repeat_interleave(n)
    phi = torch.linspace(0, pi / 2, AZIMUTHS)[:n].repeat(VIEWS)
    wo = Vec3(*(c.to(lobe.widths[0].device) for c in spherical(theta, phi)))
    return ViewTable(function(wo).view(VIEWS, n, -1).float())
