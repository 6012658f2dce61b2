"""`glossbench findings`: the page with the verdicts of all studies."""

from pathlib import Path
from typing import Annotated

import typer

from glossbench.commands.completion import results as result_folders
from glossbench.commands.printing import say
from glossbench.study.study_files import find_study_files


def findings(
    results: Annotated[
        list[Path] | None,
        typer.Argument(help="Folders of finished runs.", autocompletion=result_folders),
    ] = None,
    output: Annotated[
        Path, typer.Option("-o", "--output", help="The page; summaries go to a folder of this name without .md.")
    ] = Path("findings.md"),
) -> None:
    """Write a page of verdicts, from these results and from the stored summaries of earlier results."""
    from glossbench.atomic import replacing
    from glossbench.errors import InputError
    from glossbench.findings.page import compose_page
    from glossbench.findings.summary import Summary
    from glossbench.findings.verdicts import judge
    from glossbench.run.results import Results
    from glossbench.study.claims import read_claims

    if output.suffix != ".md":
        raise InputError(f"{output}: the page must end in .md, got {output.suffix!r}")
    kept = output.with_suffix("")
    opened = [Results.open(folder) for folder in results or []]
    for each in opened:
        if not each.disk.manifest.is_finished:
            raise InputError(f"{each.folder} is not finished; the same `glossbench run` continues it")
    for each in opened:
        cells = each.cells
        verdicts = judge(read_claims(each.study), cells)  # by the rules of this version
        summary = Summary(each.folder.resolve().name, each.study, verdicts, each.provenance, cells, each.columns)
        summary.write(kept / summary.name)
    folders = sorted(path.parent for path in kept.glob("*/claims.json"))
    if not folders:
        raise InputError(f"no results are named, and {kept} holds no summaries")
    remarks = kept / "remarks.md"
    text = remarks.read_text(encoding="utf-8") if remarks.is_file() else ""
    output.parent.mkdir(parents=True, exist_ok=True)
    with replacing(output) as part:
        part.write_text(compose_page([Summary.read(f) for f in folders], find_study_files(), text), encoding="utf-8")
    say(str(output))
