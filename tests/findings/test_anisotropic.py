"""Anisotropic materials among conditions."""

import json

import pytest

from glossbench.errors import InputError
from glossbench.findings.anisotropic import is_anisotropic
from glossbench.findings.trials import Condition


def condition(name, **options):
    return Condition(("light", json.dumps([name, options]), "view"), ("light", name, "view"))


@pytest.mark.parametrize(
    ("name", "options", "is_it"),
    [
        ("kurt", {"m": [0.3, 0.1]}, True),
        ("kurt", {"m": [0.2, 0.2]}, False),
        ("ggx", {"alpha": [0.1, 0.4]}, True),
        ("phong", {"s": 20}, False),
        ("measured", {"file": "not here.binary"}, False),
    ],
)
def test_a_material_that_turns_with_its_tangent_is_anisotropic(name, options, is_it):
    assert is_anisotropic(condition(name, **options)) == is_it


def test_a_material_that_is_not_installed_is_an_error():
    with pytest.raises(InputError, match="kurtt"):
        is_anisotropic(condition("kurtt"))
