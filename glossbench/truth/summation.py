"""The truth as a finite sum: the integral of a bilinear light against a lobe, where nothing hides the light.

The faces of the light are divided into blocks, and for each point coarse blocks into finer ones, until the sum over the
nodes of a block (block_sums.py) is accurate enough. Where a lobe is narrow, its own sampler says from the start how
small blocks must be: h^2 J <= 4 / pdf at each of 32 of its samples; blocks around them grow with the distance. Blocks
below the horizon are left out.

The error of a point is 2.5 times the root of the sum of the squares of its blocks' errors, for each channel: the errors
of blocks have either sign. In 95 % of pixels and channels or more the true error is smaller.
"""

from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor

from glossbench.brdf.material import Reflectance
from glossbench.directions import Vec3, points_2d, stack, to_world
from glossbench.envmap.cubemap import face_axes, face_coordinates
from glossbench.scene.points import ShadingPoints
from glossbench.shading.kernels import PerPoint, over_points
from glossbench.truth.block_sums import Nodes, nodes, sum_by_corners, sum_by_moments
from glossbench.truth.blocks import MOMENTS, LightBlocks
from glossbench.truth.checkpoint import Checkpoint
from glossbench.truth.pilot import SEEDS, Pilot, seed_level

FIRST, DEEPEST = 1, 22  # levels of blocks; float32 does not resolve finer ones
CHUNK = 2048  # points at a time
TRIES = 3
SAFETY = 2.5  # stated error over the root of the sum of squares
ROUNDING = 5e-6  # of the radiance, which float32 leaves
DIMMEST = 0.05  # of the mean radiance: the tolerance of a point follows its radiance from here to half the mean


class Sums(NamedTuple):
    """Sums of points.

    Attributes:
        radiance: (P, 3), float64.
        error: (P, 3), float64; as stated.
        sign: of the difference to the sum of lower order, 1 or -1, (P, 3).
        evaluations: of f, over all points.
    """

    radiance: Tensor
    error: Tensor
    sign: Tensor
    evaluations: int


class Pairs(NamedTuple):
    """Pairs of a point and a block of one level: indices (n,)."""

    point: Tensor
    face: Tensor
    row: Tensor
    column: Tensor

    def where(self, chosen: Tensor) -> "Pairs":
        """Some of the pairs."""
        at = chosen.nonzero()[:, 0]
        return Pairs(*(each[at] for each in self))

    def quarters(self) -> "Pairs":
        """Each pair as four pairs with the blocks of the next level."""
        step = torch.arange(4, device=self.point.device)
        row, column = ((2 * at[:, None] + part).flatten() for at, part in
                       ((self.row, step // 2), (self.column, step % 2)))  # fmt: skip
        return Pairs(self.point.repeat_interleave(4), self.face.repeat_interleave(4), row, column)

    def block(self, level: int) -> Tensor:
        """The number of each block."""
        return (((self.face << level) + self.row) << level) + self.column


class Seeds(NamedTuple):
    """Directions in which lobes lie: index of the point, direction (m, 3) of length 1 / major, level of its block."""

    point: Tensor
    at: Tensor
    face: Tensor
    level: Tensor

    def blocks(self, level: int) -> Tensor:
        """Sorted keys (point, block) of all blocks that are to be divided: those near the seeds of finer levels."""
        finer = self.level > level
        point, at, face = self.point[finer], self.at[finer], self.face[finer]
        n = 1 << level
        axes, keys = face_axes(str(at.device)).to(at), []
        # The corners of a box of the size of a block: they lie in all the blocks that this box meets.
        for down in (-1, 1):
            for right in (-1, 1):
                moved = at + (axes[face, 1] * right + axes[face, 2] * down) / n
                on, *place, _ = face_coordinates(Vec3(*moved.unbind(1)))
                column, row = (((k + 1) * (n / 2)).long().clamp(0, n - 1) for k in place)
                keys.append(point * (6 * n * n) + Pairs(point, on.long(), row, column).block(level))
        return torch.cat(keys).unique()


class Plan(NamedTuple):
    """How a sum will be made, from sums of a few points.

    Attributes:
        mean: mean radiance.
        tolerance: for the error of a block, relative to the mean.
        error: the stated error, RMS, relative to the mean.
        evaluations: evaluations of f per point.
        most: the largest number of evaluations of f per point.
    """

    mean: float
    tolerance: float
    error: float
    evaluations: float
    most: int


def plan_sum(pilot: Pilot, reflectance: Reflectance, light: LightBlocks, relative_error: float, most: int) -> Plan:
    """The tolerance that makes a sum as accurate as wanted, found with a few of the points."""
    some = pilot.points
    coarse = sum_blocks(some, reflectance, light, Plan(1.0, 1e30, 0.0, 0.0, most))
    mean, tolerance = float(pilot.mean(coarse.radiance)), relative_error / SAFETY
    for _ in range(5):
        plan = Plan(mean, tolerance, 0.0, 0.0, most)
        found = sum_blocks(some, reflectance, light, plan)
        error = float(pilot.mean(found.error.square()).sqrt()) / mean if mean > 0 else 0.0
        plan = plan._replace(error=error, evaluations=found.evaluations / len(some))
        is_close = 0.4 * relative_error < error <= 0.9 * relative_error or (error <= relative_error and tolerance > 1)
        if is_close or plan.evaluations >= most:
            break
        tolerance *= min(max((0.7 * relative_error / max(error, 1e-30)) ** 1.2, 0.01), 10)
    return plan


def sum_points(
    points: ShadingPoints, reflectance: Reflectance, light: LightBlocks, plan: Plan, relative_error: float,
    progress: Callable[[float, int], None], kept: Checkpoint,
) -> Sums:  # fmt: skip
    """The sums of all points, chunk by chunk; a smaller tolerance follows if the few points of the plan misled it.

    Args:
        progress: called after each chunk with the relative error and the evaluations of f per point so far.
        kept: file of the finished chunks.
    """
    sums = torch.zeros(3, len(points), 3, dtype=torch.float64, device=points.device)
    done = [0, 0, 0]  # points, evaluations, how often all began again
    kept.load(sums, done)
    while True:
        now = plan._replace(tolerance=plan.tolerance * 0.4 ** done[2])
        for start in range(done[0], len(points), CHUNK):
            some = points.map(lambda c: c[start : start + CHUNK])  # noqa: B023
            found = sum_blocks(some, reflectance, light, now)
            sums[:, start : start + CHUNK] = torch.stack(found[:3])
            done[:2] = start + len(some), done[1] + found.evaluations
            kept.save(sums, done)
            so_far = sums[:, : done[0]]
            level = float(so_far[0].mean())
            error = float(so_far[1].square().mean().sqrt()) / level if level > 0 else 0.0
            progress(error, round(done[1] / done[0]))
        if error <= relative_error or done[1] >= plan.most * len(points) or done[2] == TRIES:
            kept.remove()
            return Sums(sums[0], sums[1], sums[2], done[1])
        done = [0, 0, done[2] + 1]


def find_seeds(points: ShadingPoints, reflectance: Reflectance) -> Seeds:
    """Samples of all lobes, with the level at which a block has the size of the lobe."""
    found = []
    columns = points.columns(0, len(points))
    wo = columns.wo_local()
    u = points_2d(SEEDS).to(points.device)
    for lobe in reflectance.lobes:
        wi, pdf, _ = lobe.sample(wo, lobe.sample_points(u))
        d = stack(to_world(wi, columns.t, columns.b, columns.n))
        face, _, _, major = face_coordinates(Vec3(*d.unbind(-1)))
        level = seed_level(pdf, major)
        above = torch.broadcast_to(wi.z > 0, face.shape)
        point = torch.arange(len(points), device=d.device)[:, None].expand(face.shape)
        level = torch.broadcast_to(level.clamp(max=DEEPEST - 2), face.shape)
        found.append([each[above] for each in (point, d / major[..., None], face.long(), level)])
    if not found:
        none = torch.zeros(0, dtype=torch.long, device=points.device)
        return Seeds(none, torch.zeros(0, 3, device=points.device), none, none)
    return Seeds(*map(torch.cat, zip(*found, strict=True)))


def sum_blocks(points: ShadingPoints, reflectance: Reflectance, light: LightBlocks, plan: Plan) -> Sums:
    """The sums of some points."""
    device, n_points = points.device, len(points)
    grid, axes, normals = nodes(device), face_axes(device).to(points.n.x), stack(points.n)
    total, squares, signed = (torch.zeros(n_points, 3, dtype=torch.float64, device=device) for _ in range(3))
    seeds = find_seeds(points, reflectance)
    pairs, level, evaluations = _pair_all_blocks(n_points, device), FIRST, 0
    while len(pairs.point):
        size = 2.0 / (1 << level)
        s, t = pairs.column * size - 1, pairs.row * size - 1
        of_face = (axes[pairs.face] * normals[pairs.point][:, None]).sum(2)
        highest = of_face[:, 0] + of_face[:, 1] * s + of_face[:, 2] * t + size * of_face[:, 1:].clamp(min=0).sum(1)
        above = highest > 0
        pairs, s, t = pairs.where(above), s[above], t[above]
        divided = _find_among(seeds.blocks(level), pairs.point * (6 << 2 * level) + pairs.block(level))
        whole = ~divided
        now = pairs.where(whole)
        if len(now.point):
            place = torch.stack([now.face, s[whole], t[whole]], 1).to(normals)
            found = _evaluate(points.map(lambda c: c[now.point]), reflectance, light, grid, level, place, now)  # noqa: B023
            evaluations += len(now.point) * MOMENTS
            value, error, sign = found.split(3, 1)
            present = total.index_add(0, now.point, value.double()).mean(1)
            allowed = plan.tolerance * (2 * present).clamp(DIMMEST * plan.mean, plan.mean)
            accepted = (error <= allowed[now.point, None]).all(1)
            if level >= DEEPEST or evaluations >= plan.most * n_points:
                accepted[:] = True
            done = now.point[accepted]
            for sums, each in ((total, value), (squares, error.double().square()), (signed, sign)):
                sums.index_add_(0, done, each[accepted].double())
            divided[whole] = ~accepted
        pairs, level = pairs.where(divided).quarters(), level + 1
    error = SAFETY * squares.sqrt() + ROUNDING * total.abs()
    return Sums(total, error, torch.where(signed < 0, -1.0, 1.0), evaluations)


def _pair_all_blocks(n_points: int, device: str) -> Pairs:
    n = 1 << FIRST
    block = torch.arange(6 * n * n, device=device)
    point = torch.arange(n_points, device=device).repeat_interleave(len(block))
    block = block.repeat(n_points)
    return Pairs(point, block // (n * n), block // n % n, block % n)


def _find_among(keys: Tensor, sought: Tensor) -> Tensor:
    """Which of the sought numbers are among the sorted keys."""
    if not len(keys):
        return torch.zeros_like(sought, dtype=torch.bool)
    return keys[torch.searchsorted(keys, sought).clamp(max=len(keys) - 1)] == sought


def _evaluate(
    points: ShadingPoints,
    reflectance: Reflectance,
    light: LightBlocks,
    grid: Nodes,
    level: int,
    place: Tensor,
    pairs: Pairs,
) -> Tensor:
    """Integral, error and sign of each pair, (n, 9)."""
    size, block = torch.tensor(2.0 / (1 << level), device=points.device), pairs.block(level)
    arguments = (reflectance, grid, size, PerPoint(place))
    if level < light.finest_level:
        table, row = light.moments(level, block)
        return over_points(sum_by_moments, points, MOMENTS, *arguments, PerPoint(row[:, None]), table)
    corners = light.corners(level, block).flatten(1)
    return over_points(sum_by_corners, points, MOMENTS, *arguments, PerPoint(corners))
