"""Arguments that several commands share."""

from typing import Annotated

import typer

from glossbench.commands import completion

StudyArgument = Annotated[
    str,
    typer.Argument(
        metavar="STUDY", help="A study's name (quickstart) or the path to its YAML.", autocompletion=completion.studies
    ),
]
