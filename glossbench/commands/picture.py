"""A picture of a light: tone mapped, for a terminal or as a PNG."""

from pathlib import Path

import torch
from PIL import Image
from rich.text import Text
from torch import Tensor
from torch.nn.functional import adaptive_avg_pool2d

from glossbench.atomic import replacing
from glossbench.channels import LUMINANCE
from glossbench.envmap.cubemap import CubeMap
from glossbench.envmap.projections.conversion import from_cubemap
from glossbench.errors import InputError
from glossbench.srgb import encode
from glossbench.tone import reinhard


def draw_picture(cubemap: CubeMap, height: int) -> Tensor:
    """The light as a lat-long image, (H, 2 H, 3) uint8, sRGB; averaged over area before the tone curve."""
    fine = from_cubemap(cubemap, "lat_long", 1 << max(1, (height - 1).bit_length() - 1))
    return tone_map(adaptive_avg_pool2d(fine.permute(2, 0, 1), (height, 2 * height)).permute(1, 2, 0))


def tone_map(radiance: Tensor) -> Tensor:
    """Radiance (H, W, 3) as a display shows it, uint8.

    L' = x / (1 + x), x = 0.18 L / Lm, Lm the geometric mean of the luminance of pixels that are not black. Colours keep
    their ratios; values above 1 are clipped; the sRGB curve comes last.

    Source: Reinhard et al. 2002, eq. 1 to 3. Differs: black pixels do not count towards Lm.
    """
    luminance = radiance.double() @ torch.tensor(LUMINANCE).double()
    lit = luminance[luminance > 0]
    exposed = radiance.double() * (0.18 / lit.log().mean().exp() if len(lit) else 0.0)
    return (255 * torch.from_numpy(encode(reinhard(exposed).cpu().numpy()))).round().to(torch.uint8)


def to_half_blocks(pixels: Tensor) -> Text:
    """Pixels (H, W, 3) uint8 as text: each character shows two pixels, one above the other."""
    rows = pixels[: pixels.shape[0] // 2 * 2].tolist()
    drawn = Text(no_wrap=True, end="")
    for upper, lower in zip(rows[::2], rows[1::2], strict=True):
        for above, below in zip(upper, lower, strict=True):
            drawn.append("▀", f"rgb({','.join(map(str, above))}) on rgb({','.join(map(str, below))})")
        drawn.append("\n")
    return drawn


def write_png(path: Path, pixels: Tensor) -> None:
    """Write pixels (H, W, 3) uint8 to a .png file, completely or not at all.

    Raises:
        InputError: the name has another ending, or the folder cannot be written.
    """
    if path.suffix.lower() != ".png":
        raise InputError(f"{path}: the extension must be .png, got {path.suffix!r}")
    with replacing(path) as part:
        Image.fromarray(pixels.numpy()).save(part, format="PNG")
