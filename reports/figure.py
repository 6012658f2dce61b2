"""The class of figures. Each figure is a class in a file of `figures/`, or in another distribution under the group of
entry points `glossbench.figures`. It states its options and returns its plots as data; the page, the PDF and
`glossbench figure` show them.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, cast

from glossbench.atomic import replacing
from glossbench.errors import InputError
from glossbench.options import Options
from glossbench.run.figures import FIGURES
from glossbench.run.results import Results

from .model.options import Choice, Option
from .model.panels import Panels, select_shown
from .model.report import Report
from .print.plots import draw
from .typesetting import Format, Press

__all__ = ["FIGURES", "Case", "Figure"]


class Case(NamedTuple):
    """One set of choices, by option, and what the figure shows for it."""

    choices: Mapping[str, Choice]
    panels: Panels


class Figure(Options):
    """A figure of results. A subclass registers with `@FIGURES.register("name")`; its first line says what it shows.

    Attributes:
        options: by the name of the argument of `data`; an option may depend on those before it.
        in_reports: whether page and PDF show it; the command line always can.
    """

    options: ClassVar[Mapping[str, Option]] = {}
    in_reports: ClassVar[bool] = True

    def data(self, report: Report, **given: Any) -> Panels:
        """Its plots for these values of all options."""
        raise NotImplementedError

    def cases(self, report: Report) -> Iterator[Case]:
        """All combinations of choices for which the figure shows something."""
        for choices in self._choices(report, list(self.options)):
            panels = self.data(report, **{name: choice.value for name, choice in choices.items()})
            if panels.panels:
                yield Case(choices, panels)

    def write(self, results: Results, path: Path, **asked: Any) -> None:
        """Write it to a file, whole or not at all.

        Args:
            path: its extension is the format: .pdf, .svg or .png.
            asked: the options that the user states, as text or numbers.

        Raises:
            InputError: an option has no such choice, or the format is unknown.
        """
        form = path.suffix.lower().lstrip(".")
        if form not in ("pdf", "svg", "png"):
            raise InputError(f"{path}: the extension must be .pdf, .svg or .png, got {path.suffix!r}")
        content = self.draw(results, cast("Format", form), **asked)
        with replacing(path) as part:
            part.write_bytes(content)

    def draw(self, results: Results, form: "Format", **asked: Any) -> bytes:
        """The file of `write`, in one of its formats; raises as `write` does."""
        report = Report.from_results(results)
        given: dict[str, Any] = {}
        for name, option in self.options.items():
            given[name] = option.asked(report, given, asked.get(name))
        with Press() as press:
            return press.pages("figure.typ", self.printed(report, press, **given), form)

    def printed(self, report: Report, press: Press, **given: Any) -> dict[str, Any]:
        """The data for the template of a single figure; InputError if there is nothing to show."""
        data = self.data(report, **given)
        if not data.panels:
            raise InputError(
                f"{report.results.store.address} has nothing to show as {self.name}: {data.note or 'no cell'}"
            )
        figure = press.figure(draw(select_shown(data.panels)))
        return {"kind": "plot", "alt": " ".join(filter(None, (given.get("metric"), data.title))), **figure}

    def _choices(self, report: Report, names: Sequence[str]) -> Iterator[dict[str, Choice]]:
        """All combinations of the choices of these options, each after those before it."""
        if not names:
            yield {}
            return
        *before, last = names
        for chosen in self._choices(report, before):
            given = {name: choice.value for name, choice in chosen.items()}
            for choice in self.options[last].choices(report, given):
                yield {**chosen, last: choice}
