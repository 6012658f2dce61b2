"""`glossbench light`: facts about a light, a picture of it, and the light written in another projection."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from glossbench.commands.completion import lights
from glossbench.commands.printing import out, print_rows, say
from glossbench.errors import InputError

if TYPE_CHECKING:
    from glossbench.envmap.lights.facts import LightFacts
    from glossbench.envmap.projections.conversion import Written

SHORT = {"cross": "vertical_cross"}
Axes = "forward, opengl, directx, mitsuba, blender, pbrt or nvdiffrec"


def light(
    name: Annotated[
        str, typer.Argument(metavar="FILE|NAME", help="An image file, or a light's name.", autocompletion=lights)
    ],
    resolution: Annotated[int | None, typer.Option(help="Texels along the edge of a face, a power of two.")] = None,
    projection: Annotated[str | None, typer.Option(help="Projection of the file (default: as it states).")] = None,
    axes: Annotated[str | None, typer.Option(help=f"Axes of the file (default: as it states): {Axes}.")] = None,
    flip: Annotated[bool, typer.Option("--flip", help="The first row of the file is straight down.")] = False,
    layer: Annotated[str | None, typer.Option(help="Layer or part to read from an .exr with several.")] = None,
    ldr: Annotated[bool, typer.Option("--ldr", help="Accept a file of 8-bit integers, decoded from sRGB.")] = False,
    invalid: Annotated[
        str | None, typer.Option(help="Pixels that are negative or not finite: refuse or clamp.")
    ] = None,
    png: Annotated[Path | None, typer.Option(help="Write a tone-mapped picture to this .png file.")] = None,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Write the light to this .exr file.")] = None,
    written: Annotated[
        str,
        typer.Option(
            "--as", metavar="PROJECTION",
            help="Projection of the written file: lat_long, angular, vertical_cross (or cross), horizontal_cross, "
            "strip, dual_paraboloid, octahedral or octahedral_equal_area.",
        ),
    ] = "lat_long",
    written_axes: Annotated[str, typer.Option("--as-axes", help="Axes of the written file.")] = "forward",
) -> None:  # fmt: skip
    """Describe a light, draw it, and write it in another projection."""
    from glossbench.commands.picture import draw_picture, to_half_blocks, write_png
    from glossbench.envmap.formats.exr import check_exr_name, write_exr
    from glossbench.envmap.formats.image_content import Covering
    from glossbench.envmap.lights.file_light import make_light
    from glossbench.envmap.projections.conversion import check_written, from_cubemap

    if output is None and (written, written_axes) != ("lat_long", "forward"):
        raise InputError("--as and --as-axes need -o, the file to write")
    form = cast("Written", SHORT.get(written, written))
    if output is not None:
        check_exr_name(output)
        check_written(form, written_axes)
    flags = {"flip_vertical": flip or None, "layer": layer, "ldr": ldr or None}
    given = {"resolution": resolution, "projection": projection, "axes": axes, "invalid": invalid, **flags}
    chosen = make_light(name, {option: value for option, value in given.items() if value is not None})
    cubemap = chosen.cubemap()
    print_rows({"light": name} | describe_facts(chosen.facts(cubemap)) | {"note": "\n".join(chosen.notes())})
    if out.is_terminal and out.color_system and out.encoding.startswith("utf"):  # else the picture cannot be shown
        out.print(to_half_blocks(draw_picture(cubemap, min(out.width, 160) // 2)))
    if png is not None:
        write_png(png, draw_picture(cubemap, 512))
        say(f"picture: {png}")
    if output is not None:
        image = from_cubemap(cubemap, form, axes=written_axes)
        write_exr(output, image, covers=Covering(form, written_axes))
        say(f"{form}: {output}")


def describe_facts(facts: "LightFacts") -> dict[str, str]:
    """The facts about a light, each in a few words."""
    read_as, image_peak = "", ""
    if facts.projection is not None:
        axes = "" if facts.axes == "forward" else f", axes {facts.axes}"
        read_as = f"{facts.projection}{axes}, {facts.width} x {facts.height} pixels"
        image_peak = f" (brightest pixel of the file: {facts.image_peak:.4g})"
    return {
        "read as": read_as,
        "cube map": f"6 faces of {facts.resolution} x {facts.resolution} texels",
        "mean radiance": _format_rgb(facts.mean),
        "peak luminance": f"{facts.peak:.4g}{image_peak}",
        "dynamic range": f"{float(f'{facts.dynamic_range:.3g}'):,.0f} : 1",
        "brightest 0.1 %": f"{100 * facts.brightest_share:.3g} % of the energy",
        "irradiance up": _format_rgb(facts.irradiance_up),
        "irradiance right": _format_rgb(facts.irradiance_right),
        "irradiance forward": _format_rgb(facts.irradiance_forward),
    }


def _format_rgb(color: tuple[float, float, float]) -> str:
    return "  ".join(f"{c:<8.4g}" for c in color).rstrip()
