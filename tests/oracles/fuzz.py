"""Mutated studies and images: each must load, or be refused by InputError, in bounded time.

    PYTHONPATH=tests python -m oracles.fuzz studies 2000 --seed 0

An input is made from its number alone; `... 1 --seed N` makes number N again.
"""

import argparse
import faulthandler
import random
import re
import resource
import signal
import struct
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenEXR
import OpenImageIO as oiio
import torch
from skimage.io import imsave

from glossbench.envmap.formats.files import read_image
from glossbench.errors import InputError
from glossbench.study.study import load_study

SECONDS = 20  # for one input; measured, 2000 take less than 45
MEMORY = 12 << 30  # of address space: an image of 2^28 pixels is refused, and what a sound one needs is far less

Load = Callable[[Path], object]


def studies() -> list[tuple[str, bytes]]:
    """The installed studies that name no file, which might be fetched."""
    files = sorted((Path(__file__).parents[2] / "studies").glob("*.yaml"))
    return [("study.yaml", file.read_bytes()) for file in files if b".hdr" not in file.read_bytes()]


def images(folder: Path) -> list[tuple[str, bytes]]:
    """Small images of each format and coding."""
    pixels = np.random.default_rng(1).random((8, 16, 3), dtype=np.float32) + 0.5
    for compression in ("NO", "RLE", "ZIP", "PIZ", "PXR24", "DWAA"):
        header = {"compression": getattr(OpenEXR, f"{compression}_COMPRESSION"), "type": OpenEXR.scanlineimage}
        planes = {name: np.ascontiguousarray(pixels[..., i]) for i, name in enumerate("RGB")}
        OpenEXR.File(header, planes).write(str(folder / f"{compression}.exr"))
    output = oiio.ImageOutput.create("planes.hdr")
    output.open(str(folder / "planes.hdr"), oiio.ImageSpec(16, 8, 3, oiio.FLOAT))
    output.write_image(pixels)
    output.close()
    imsave(folder / "small.png", (pixels * 100).astype(np.uint8), check_contrast=False)
    (folder / "flat.hdr").write_bytes(
        b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=2\n\n-Y 8 +X 16\n" + b"ab\3\x80" * 128
    )
    (folder / "small.pfm").write_bytes(b"PF\n16 8\n-1.0\n" + pixels.tobytes())
    surface = struct.pack("<4s7I44x2I4s5I4I4x", b"DDS ", 124, 0x1007, 8, 8, 0, 0, 0, 32, 4, struct.pack("<I", 116),
                          0, 0, 0, 0, 0, 0x1008, 0xFE00, 0, 0)  # fmt: skip
    (folder / "small.dds").write_bytes(surface + np.ones((6, 8, 8, 4), np.float32).tobytes())
    return [(file.name, file.read_bytes()) for file in sorted(folder.iterdir())]


def mutated(content: bytes, other: bytes, is_text: bool, draw: random.Random) -> bytes:
    """One to four changes: bits, bytes, cuts, pieces moved, doubled or taken from another; of text, words swapped."""
    data = bytearray(content)
    for _ in range(draw.randint(1, 4)):
        # Half of all changes are made where headers are.
        reach = min(len(data), 256) if draw.random() < 0.5 else len(data)
        at, to = sorted((draw.randrange(reach), draw.randrange(reach)))
        kind = draw.randrange(9 if is_text else 7)
        if kind == 0:
            data[at] ^= 1 << draw.randrange(8)
        elif kind == 1:
            data[at] = draw.choice([0, 1, 0x7F, 0x80, 0xFF, draw.randrange(256)])
        elif kind == 2:
            data = data[: at + 1]
        elif kind == 3:
            del data[at : at + draw.randint(1, 8)]
        elif kind == 4:
            data[at:at] = data[at : min(to, at + 64)]
        elif kind == 5:
            start = draw.randrange(len(other))
            data[at:at] = other[start : start + draw.randint(1, 64)]
        elif kind == 6:
            data[at : at + 4] = struct.pack("<I", draw.choice([0, 1, 0xFFFFFFFF, 0x7FFFFFFF, 1 << draw.randrange(32)]))
        else:
            words = re.split(r"(\W+)", data.decode("utf-8", "replace"))
            first, second = draw.randrange(len(words)), draw.randrange(len(words))
            odd = [
                "~",
                "[]",
                "{}",
                "-1",
                "1e400",
                ".nan",
                "true",
                "'",
                '"',
                "&a",
                "*a",
                "!!int",
                "<<",
                "\t",
                "0",
                "9" * 400,
            ]
            words[first] = words[second] if kind == 7 else draw.choice(odd)
            data = bytearray("".join(words).encode())
        if not data:
            return b"\0"
    return bytes(data)


def interrupted(*_: object) -> None:
    raise TimeoutError(f"took more than {SECONDS} s")


def outcomes_of(load: Load, sound: list[tuple[str, bytes]], numbers: range, log: Path | None = None) -> Counter[str]:
    """How often mutated inputs load and are refused; each fault is a separate outcome."""
    signal.signal(signal.SIGALRM, interrupted)
    outcomes: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for number in numbers:
            if log:
                log.write_text(str(number))
            draw = random.Random(number)
            (file, content), (_, other) = draw.choice(sound), draw.choice(sound)
            path = folder / file
            path.write_bytes(mutated(content, other, file.endswith(".yaml"), draw))
            signal.setitimer(signal.ITIMER_REAL, SECONDS)
            try:
                load(path)
                outcomes["loads"] += 1
            except InputError as error:
                lines = str(error).count("\n") + 1
                outcomes["refused" if lines == 1 else f"number {number}, {file}: {lines} lines: {error}"] += 1
            except BaseException as error:
                outcomes[f"number {number}, {file}: {type(error).__name__}: {str(error)[:200]}"] += 1
            signal.setitimer(signal.ITIMER_REAL, 0)
            path.unlink()
            outcomes.update(f"number {number}, {file}: left {left.name} behind" for left in folder.iterdir())
    return outcomes


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("target", choices=["studies", "images"])
    parser.add_argument("count", type=int)
    parser.add_argument("--seed", type=int, default=0, help="the first number")
    parser.add_argument("--log", type=Path, help="holds the number that is under way, for when the process dies")
    options = parser.parse_args()
    torch.set_num_threads(1)
    faulthandler.enable()
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    numbers = range(options.seed, options.seed + options.count)
    if options.target == "studies":
        outcomes = outcomes_of(load_study, studies(), numbers, options.log)
    else:
        with tempfile.TemporaryDirectory() as folder:
            sound = images(Path(folder))
        outcomes = outcomes_of(lambda path: read_image(path, ldr=True), sound, numbers, options.log)
    faults = [text for text in outcomes if text.startswith("number")]
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss >> 10
    print(f"{outcomes['loads']} load, {outcomes['refused']} refused, {len(faults)} faults, {memory} MiB")
    print("\n".join(faults[:20]))
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
