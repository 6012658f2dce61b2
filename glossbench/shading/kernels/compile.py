"""Compiling one kernel in a process of its own, because the compiler takes seconds to import and changes the process.

The process reads the pickled arguments of `compile_kernel` from standard input, writes the artefact, and ends with
exit code 0. Otherwise the last line on standard error says why.
"""

import os
import pickle
import signal
import sys
import warnings
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import torch
from torch import Tensor

from glossbench.process.surroundings import settled
from glossbench.shading.kernels.arguments import Form
from glossbench.shading.kernels.artefacts import Size, store, target
from glossbench.shading.kernels.programs import Part, program

# Dimensions of up to so many are compiled as they are: channels, axes, the probes of a loop.
SMALL = 4
Type = tuple[torch.dtype, tuple[int, ...]]
OPTIONS = {
    "cpp.vec_isa_ok": True,  # by default torch tests each vector extension by a program, which takes 20 s
    "cpp.dynamic_threads": True,  # the number of threads is that of the calling process, not of this one
    "aot_inductor.enable_line_tables": False,
    "aot_inductor.compile_wrapper_opt_level": "O0",
}


class _Module(torch.nn.Module):
    """A program in the form that torch exports."""

    def __init__(self, run: Callable[[Sequence[Tensor]], Any]) -> None:
        super().__init__()
        self._run = run

    def forward(self, tensors: list[Tensor]) -> Any:
        """Run the program."""
        return self._run(tensors)


@settled()
def compile_kernel(place: tuple[str, str], form: Form, types: list[Type], key: str, part: Part) -> None:
    """Compile a kernel for all sizes, and store it.

    Args:
        place: module and name of the kernel.
        form: form of its arguments.
        types: type and shape of each tensor.
        key: key of the artefact.
        part: which part of the kernel to compile.
    """
    from torch._inductor import aoti_compile_and_package
    from torch.export import Dim, export

    kernel = getattr(import_module(place[0]), place[1])
    tensors = [torch.zeros(shape, dtype=dtype) for dtype, shape in types]
    n_arguments = len(tensors)
    with torch.no_grad():
        if part == "after rays":
            tensors.append(_answer_like(program(kernel.function, form, "before rays"), tensors))
        free = [{i: Dim.AUTO for i, n in enumerate(t.shape) if n > SMALL} for t in tensors]
        run = _Module(program(kernel.function, form, part))
        exported = export(run, (tensors,), dynamic_shapes=(free,), strict=False)
    values = {node.name: node.meta["val"] for node in exported.graph.nodes if node.op == "placeholder"}
    sizes = [[_size(n) for n in values[name].shape] for name in exported.graph_signature.user_inputs][:n_arguments]
    ranges = {str(symbol): [int(r.lower), _largest(r.upper)] for symbol, r in exported.range_constraints.items()}
    spec = exported.call_spec.out_spec
    n_outputs = None if spec.is_leaf() else spec.num_children
    with TemporaryDirectory() as folder:
        package = Path(folder) / "kernel.pt2"
        aoti_compile_and_package(exported, package_path=str(package), inductor_configs=OPTIONS)
        library = _library(package, Path(folder))
        facts = {
            "kernel": kernel.name, "target": target(), "sizes": sizes, "ranges": ranges, "n_outputs": n_outputs,
            "seconds": sum(os.times()[:4]),
        }  # fmt: skip
        store(key, library, facts)


def main() -> None:
    """Entry point of the process."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # temporary folders are removed
    sys.path[:] = pickle.load(sys.stdin.buffer)  # plug-ins lie where the process that asks has found them
    arguments = pickle.load(sys.stdin.buffer)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the compiler itself
        compile_kernel(*arguments)


def _answer_like(before: Callable[[Sequence[Tensor]], Any], tensors: Sequence[Tensor]) -> Tensor:
    """A tensor like the one that says for each sample whether it sees the light; only its shape is computed."""
    from torch._subclasses.fake_tensor import FakeTensorMode

    with FakeTensorMode(allow_non_fake_inputs=True) as mode:
        needed = before([mode.from_tensor(t) for t in tensors])[0]
    return torch.zeros(needed.shape, dtype=needed.dtype)


def _size(n: Any) -> Size:
    if isinstance(n, int) or n.node.expr.is_number:  # a loop over it, for example, has made it a number
        return int(n)
    if not n.node.expr.is_symbol:
        raise NotImplementedError(f"the sizes of its arguments depend on each other: {n.node.expr}")
    return str(n.node.expr)


def _largest(bound: Any) -> int:
    """A bound of torch's as a number; its infinity is larger than any size."""
    return min(int(bound), 2**62) if getattr(bound, "is_finite", True) and str(bound) != "int_oo" else 2**62


def _library(package: Path, folder: Path) -> Path:
    """The shared library in a package, which is a zip file."""
    from zipfile import ZipFile

    with ZipFile(package) as opened:
        (name,) = [each for each in opened.namelist() if each.endswith(".so")]
        return Path(opened.extract(name, folder))


if __name__ == "__main__":
    main()
