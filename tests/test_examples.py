"""The examples in docstrings give what they say."""

import doctest
import importlib
from typing import Annotated

import pytest
from pydantic import Field

WITH_EXAMPLES = ("glossbench.directions", "glossbench.options", "glossbench.study.labels")


@pytest.mark.parametrize("name", WITH_EXAMPLES)
def test_an_example_gives_what_it_says(name):
    tried = doctest.testmod(importlib.import_module(name), extraglobs={"Annotated": Annotated, "Field": Field})

    assert tried.attempted > 0
    assert tried.failed == 0


def test_an_example_that_says_something_else_is_noticed(capsys):
    example = doctest.DocTestParser().get_doctest(">>> 1 + 1\n3\n", {}, "planted", None, None)

    assert doctest.DocTestRunner().run(example).failed == 1
    assert "Expected:\n    3" in capsys.readouterr().out
