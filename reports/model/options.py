"""Options of figures: a list of choices on the page, an option on the command line."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol

from glossbench.errors import InputError, suggest_nearest
from glossbench.findings.costs import COSTS

from .axes import Place, Sweep, find_named, with_costs
from .conditions import Group
from .crops import Crop
from .report import Report


class Choice(NamedTuple):
    """One value of an option.

    Attributes:
        name: the text that selects it; "" if it has no name.
        title: the text that is shown.
        value: the value that the figure receives.
        part: the heading in the list of choices; "" without one.
    """

    name: str
    title: str
    value: Any
    part: str = ""


class Option(Protocol):
    """One option of a figure; `given` are the values of the options before it."""

    title: str

    def choices(self, report: Report, given: Mapping[str, Any]) -> Sequence[Choice]:
        """All choices; the first is the default."""

    def asked(self, report: Report, given: Mapping[str, Any], text: Any) -> Any:
        """The value of the choice with this name or number, or of the first for None; InputError for an unknown one."""


class MetricOption:
    """A metric of the results or, with `with_costs`, a cost."""

    title = "Metric or cost"

    def __init__(self, with_costs: bool = False) -> None:
        self.with_costs = with_costs

    def choices(self, report: Report, given: Mapping[str, Any]) -> list[Choice]:
        costs = COSTS.items() if self.with_costs and report.measured else ()
        return [
            *(Choice(name, name, name, "Metrics") for name in report.measured),
            *(Choice(cost, title, cost, "Costs") for cost, title in costs),
        ]

    def asked(self, report: Report, given: Mapping[str, Any], text: str | None) -> str:
        if text is None:
            return report.metrics[0] if report.metrics else "rms"
        if text not in report.measured and not (self.with_costs and text in COSTS):
            raise InputError(
                f"{report.results.store.address} has no metric {text!r}{suggest_nearest(text, report.measured)}"
            )
        return text


class AxisOption:
    """A sweep of the study; with `with_costs`, only those along which errors are plotted against costs."""

    title = "Over"

    def __init__(self, with_costs: bool = False) -> None:
        self.with_costs = with_costs

    def choices(self, report: Report, given: Mapping[str, Any]) -> list[Choice]:
        known = with_costs(report.axes) if self.with_costs else report.axes.values()
        return [Choice(axis.name, axis.title, axis) for axis in known]

    def asked(self, report: Report, given: Mapping[str, Any], text: str | None) -> Sweep:
        known: list[Sweep] = [choice.value for choice in self.choices(report, given)]
        if text is None:
            return known[0]
        found = find_named(known, text)
        if len(found) > 1:
            meant = " or ".join(axis.full_name for axis in found)
            raise InputError(f"--over {text} may mean {meant}: say which")
        if not found:
            names = ", ".join(axis.name for axis in known)
            raise InputError(f"{report.results.store.address} does not sweep {text!r}: --over must be one of {names}")
        return found[0]


class PlaceOption:
    """Where lines over the chosen axis are compared: a light, material and view, or a mean over lights."""

    title = "At"

    def choices(self, report: Report, given: Mapping[str, Any]) -> list[Choice]:
        return _number_members(report.places(given["over"]))

    def asked(self, report: Report, given: Mapping[str, Any], number: int | None) -> Place:
        place: Place = _pick(report, self.choices(report, given), number)
        return place


class GroupOption:
    """A light, material and view that has images."""

    title = "At"

    def choices(self, report: Report, given: Mapping[str, Any]) -> list[Choice]:
        return _number_members(report.done)

    def asked(self, report: Report, given: Mapping[str, Any], number: int | None) -> Group:
        group: Group = _pick(report, self.choices(report, given), number)
        return group


class ErrorOption:
    """The error that error maps show: a metric of the results; by default the signed error."""

    title = "Error"

    def choices(self, report: Report, given: Mapping[str, Any]) -> list[Choice]:
        return [Choice("", "image − reference", None), *MetricOption().choices(report, given)]

    def asked(self, report: Report, given: Mapping[str, Any], text: str | None) -> str | None:
        return None if text is None else MetricOption().asked(report, given, text)


class CropsOption:
    """Windows in the images of the chosen group; by default those where methods err most."""

    title = "Crops"

    def choices(self, report: Report, given: Mapping[str, Any]) -> list[Choice]:
        return [Choice("", "where methods err most", ())]

    def asked(
        self, report: Report, given: Mapping[str, Any], windows: Sequence[tuple[int, int, int, int]] | None
    ) -> list[Crop]:
        height, width = report.results.mask(given["group"].reference["reference_key"]).shape
        crops = [Crop(*window) for window in windows or ()]
        for crop in crops:
            is_inside = crop.x + crop.width <= width and crop.y + crop.height <= height
            if min(crop) < 0 or min(crop.width, crop.height) < 1 or not is_inside:
                asked = ",".join(map(str, crop))
                raise InputError(f"--crop X,Y,WIDTH,HEIGHT must lie within {width} x {height} pixels, got {asked}")
        return crops


def _number_members(members: Sequence[Group | Place]) -> list[Choice]:
    return [Choice(str(i), each.title, each) for i, each in enumerate(members, 1)]


def _pick(report: Report, choices: Sequence[Choice], number: int | None) -> Any:
    """The choice with this number, counted from 1; without a number, the only choice."""
    titles = "; ".join(f"{choice.name}: {choice.title}" for choice in choices)
    if not choices:
        raise InputError(f"{report.results.store.address} has no cell with an image")
    if number is None and len(choices) > 1:
        raise InputError(f"which light, material and view? --group must be one of {titles}")
    if number is not None and not 1 <= number <= len(choices):
        raise InputError(f"--group must be one of {titles}, got {number}")
    return choices[(number or 1) - 1].value
