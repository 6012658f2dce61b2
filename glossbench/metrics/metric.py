"""The interface of a metric: an error map, and one number that summarises it."""

import json
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np

from glossbench.catalog.naming import explain_catalog_name
from glossbench.errors import InputError, describe_wrong_value
from glossbench.options import Options
from glossbench.process.surroundings import settled
from glossbench.registry import Registry
from glossbench.shapes import Colours, ErrorMap, Errors, Mask, Masked, Picture


@runtime_checkable
class RadianceImage(Protocol):
    """An image: radiance, and the mask of the pixels that show the surface."""

    @property
    def radiance(self) -> Picture: ...
    @property
    def mask(self) -> Mask: ...


class Metric(Options):
    """Computes a number and an error map from an image and a reference of the same view.

    `metric(image, truth)` is the number, `metric.error_map(image, truth)` the map. A subclass defines `errors`, which
    computes the map, and `pooled`, which computes the number from it; the default is the mean over the mask.

    Attributes:
        formula: formula of the number in plain text; x is the image, y the reference, means are over masked pixels
            and channels.
        unit: unit of the number and the map under default options.
        map_formula: formula of one pixel of the map; means are over its channels.
        lower_is_better: whether a lower absolute value of the number is better.
        signed: whether the map has both signs; otherwise it is at least 0, and 0 means no error.
        n_groups: 8, 4 or 2. For its standard error the number is computed this many more times, each time against a
            reference without one group of its replicates. A metric that takes seconds should use fewer.
    """

    formula: ClassVar[str]
    unit: ClassVar[str]
    map_formula: ClassVar[str] = ""
    lower_is_better: ClassVar[bool] = True
    signed: ClassVar[bool] = False
    n_groups: ClassVar[int] = 8

    @settled()
    def __call__(self, image: RadianceImage, truth: RadianceImage) -> float:
        """The number.

        Raises:
            InputError: sizes or masks differ, the mask is empty, or radiance on it is not finite.
        """
        x, y, mask = _prepare_images(image, truth)
        return float(self.pooled(self.errors(self.compared(x), self.compared(y), mask)[mask]))

    @settled()
    def error_map(self, image: RadianceImage, truth: RadianceImage) -> ErrorMap:
        """The error of each pixel, zero outside the mask; it raises the same errors as the number."""
        x, y, mask = _prepare_images(image, truth)
        return np.where(mask, self.errors(self.compared(x), self.compared(y), mask), 0.0)

    def compared(self, radiance: Colours) -> Colours:
        """The values of an image that `errors` compares: by default its radiance."""
        return radiance

    @classmethod
    def unit_with(cls, options: Mapping[str, Any]) -> str:
        """The unit under some options; those that are left out have their defaults."""
        return cls.unit

    def errors(self, x: Colours, y: Colours, mask: Masked) -> ErrorMap:
        """The error of each pixel of an image and a reference, both zero outside the mask."""
        raise NotImplementedError

    def pooled(self, errors: Errors) -> float:
        """The number, from the errors of the masked pixels."""
        return float(np.mean(errors))


def name_columns(metrics: Sequence[tuple[str, Mapping[str, Any]]]) -> list[str]:
    """Column names of metrics given by name and options: the name or, if it occurs twice, "mrse (epsilon 0.1)"."""
    found = []
    for name, options in metrics:
        same = [other for each, other in metrics if each == name]
        told = [f"{key} {value if isinstance(value, str) else json.dumps(value)}" for key, value in options.items()
                if any(other.get(key) != value for other in same)]  # fmt: skip
        found.append(f"{name} ({', '.join(told)})" if told else name)
    return found


METRICS: Registry[Metric] = Registry("metric", "glossbench.metrics", "glossbench.metrics", explain_catalog_name)


def _prepare_images(image: RadianceImage, truth: RadianceImage) -> tuple[Colours, Colours, Masked]:
    """Image and reference in double precision, zero outside their mask, and the mask; InputError if they do not fit."""
    for which, given in {"image": image, "truth": truth}.items():
        # isinstance of a protocol takes 20 us, and a cell is compared nine times.
        if getattr(given, "radiance", None) is None or getattr(given, "mask", None) is None:
            raise InputError(
                f"metric(image, truth): {which} must have radiance and mask, got {describe_wrong_value(given)}"
            )
    # A reference has the standard error of its radiance, an image has none.
    if getattr(image, "standard_error", None) is not None and getattr(truth, "standard_error", None) is None:
        raise InputError("metric(image, truth): the reference comes second, got it first")
    mask = truth.mask.cpu().numpy()
    if image.mask.shape != mask.shape:
        sizes = " and ".join(f"{shape[1]} x {shape[0]}" for shape in (image.mask.shape, mask.shape))
        raise InputError(f"image and reference must be of one view, got {sizes} pixels")
    if n_other := int((image.mask.cpu().numpy() != mask).sum()):
        raise InputError(f"image and reference must be of one view, but {n_other} pixels are in one mask only")
    if not mask.any():
        raise InputError("the mask of the reference is empty: no pixel shows the surface")
    return _check_radiance("the image", image, mask), _check_radiance("the reference", truth, mask), mask


def _check_radiance(what: str, image: RadianceImage, mask: Masked) -> Colours:
    if tuple(image.radiance.shape) != (*mask.shape, 3):
        raise InputError(
            f"radiance of {what} must be {(*mask.shape, 3)}, as its mask, got {tuple(image.radiance.shape)}"
        )
    radiance = np.where(mask[..., None], image.radiance.detach().double().cpu().numpy(), 0.0)
    if not np.isfinite(radiance).all():
        n_bad = int((~np.isfinite(radiance)).any(axis=2).sum())
        raise InputError(f"radiance of {what} must be finite, but {n_bad} of {int(mask.sum())} masked pixels are not")
    return radiance
