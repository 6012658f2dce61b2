"""What is compiled of a kernel: a function of tensors alone.

A kernel that casts rays is two programs, one before the rays and one after them (glossbench/shading/visibility.py).
"""

from collections.abc import Callable, Sequence
from typing import Any, Literal

from torch import Tensor

from glossbench.shading.kernels.arguments import Form, rebuild
from glossbench.shading.visibility import Answered, Asked

Part = Literal["whole", "before rays", "after rays"]


def program(function: Callable[..., Any], form: Form, part: Part) -> Callable[[Sequence[Tensor]], Any]:
    """A part of a kernel, as a function of the tensors of its arguments.

    "before rays" returns which samples need a ray, and the three components of their directions. "after rays" takes a
    further last tensor, which says for each sample whether it sees the light.
    """

    def whole(tensors: Sequence[Tensor]) -> Any:
        return function(*rebuild(form, tensors))

    def before(tensors: Sequence[Tensor]) -> Any:
        asked = Asked()
        function(*rebuild(form, tensors, asked))
        if len(asked.questions) != 1:
            raise NotImplementedError(f"it casts rays {len(asked.questions)} times, must do so once")
        needed, direction = asked.questions[0]
        return (needed, *direction)

    def after(tensors: Sequence[Tensor]) -> Any:
        return function(*rebuild(form, tensors[:-1], Answered(tensors[-1])))

    return {"whole": whole, "before rays": before, "after rays": after}[part]
