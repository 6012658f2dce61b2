"""Hints in the messages for wrong studies: each line says what to write instead."""

from pathlib import Path

import pytest

from glossbench.errors import InputError
from glossbench.study.study import load_study

STUDY = {
    "title": "T",
    "light": "{constant: {resolution: 8}}",
    "material": "{ggx: {alpha: 0.5}}",
    "view": "{sphere: {resolution: 4}}",
    "methods": "{importance_sampling: {samples: [4, 8]}}",
}


def a_study(**changes: str) -> str:
    return "".join(f"{key}: {value}\n" for key, value in (STUDY | changes).items())


def a_claim(claim: str) -> str:
    return a_study(claims=f"[{{text: A, {claim}}}]")


VALUE = "value: importance_sampling, of: rms, equals: 1"
SAMPLES = "methods[0].importance_sampling.samples"
NO_COLON = "mapping values are not allowed here"
# What is written -> its place, and the whole line after that, or how it begins.
HINTS = [
    (a_study(methods="\n- importance_sampling: samples: 16"), "6:31",
     f"{NO_COLON}; on one line it is written - importance_sampling: {{samples: 16}}"),
    (a_study(light="spots: seed: 1"), "2:13", f"{NO_COLON}; on one line it is written light: {{spots: {{seed: 1}}}}"),
    (a_study(title="Roughness: a study"), "1:17",
     f"{NO_COLON}; text with a colon needs quotes: title: 'Roughness: a study'"),
    ("title:T\nlight: constant\n", "2:6", f"{NO_COLON}; a colon needs a space after it, on the line above: title: T"),
    ("title: T\n light: constant\n", "2:7", f"{NO_COLON}; it is indented deeper than the line above"),
    (a_study(methods="\n- importance_sampling:\n    samples: 16\n   seed: 3"), "8:4",
     "expected <block end>, but found '<block mapping start>'; its indentation fits no key above it"),
    (a_study(methods="\n- importance_sampling:\n  samples: 16"), "6:3",
     "methods[0] must be a name, or one name with its options below it, got the keys 'importance_sampling', 'samples'; "
     "indent 'samples' deeper than 'importance_sampling'"),
    (a_study(methods="\n  importance_sampling:\n  environment_sampling:"), "6:3",
     "methods must be a name, or one name with its options below it, got the keys 'importance_sampling', "
     "'environment_sampling'; begin each method with a dash"),
    (a_study(methods="\n-importance_sampling"), "6:1",
     "could not find expected ':'; a plain dash and a space begin an item: - importance_sampling"),
    (a_study(methods="\n– importance_sampling"), "6:1",
     "could not find expected ':'; a plain dash and a space begin an item: - importance_sampling"),
    (a_study(title='"a" and b'), "1:12", "expected <block end>, but found '<scalar>'; text that begins with a sign"),
    (a_study(title="%a"), "1:8", "found character '%' that cannot start any token; text that begins with a sign needs"),
    (a_study(methods="{importance_sampling:\t{samples: 4}}"), "5:31", "a tab is not allowed here; use a space"),
    (a_study(methods="{importance_sampling: {samples:16}}"), "5:33",
     "methods.importance_sampling: unknown option 'samples:16'; a colon needs a space after it: samples: 16"),
    (a_study(methods="\n- importance_sampling: {<<: {samples: 4}}"), "6:25",
     "methods[0].importance_sampling: keys cannot be merged by <<; write them out, or an alias for a whole value"),
    # Numbers
    (a_study(material="\n- ggx:\n    alpha: 0,2"), "5:12",
     "material[0].ggx.alpha must be a list, got '0,2'; a number has a point, 0.2, and a list brackets, [0, 2]"),
    (a_study(material="{ggx: {alpha: 0,2}}"), "3:27",
     "material.ggx: a key must be text, got '2'; a number has a point and not a comma: 0.2"),
    (a_study(methods="\n- importance_sampling:\n    samples: 4, 8"), "7:14",
     f"{SAMPLES} must be a valid integer, got '4, 8'; a list is written [4, 8]"),
    (a_study(methods="\n- importance_sampling: {samples: 16.0}"), "6:34",
     f"{SAMPLES} must be a valid integer, got 16.0; write 16"),
    (a_study(methods="\n- importance_sampling: {samples: '16'}"), "6:34",
     f"{SAMPLES} must be a valid integer, got '16'; without quotes it is a number: 16"),
    (a_study(methods="\n- importance_sampling: {samples: 1_000}"), "6:34",
     f"{SAMPLES} must be a valid integer, got '1_000'; write 1000"),
    (a_study(methods="\n- importance_sampling: {samples: 010}"), "6:34",
     "'010' is not a valid int; write 10, or 0o10 for base 8"),
    (a_study(reference="{relative_error: 1%}"), "6:29",
     "reference.relative_error must be a valid number, got '1%'; write a number alone: 0.01"),
    (a_study(time_limit="60s"), "6:13", "time_limit must be a valid number, got '60s'; write 60 alone"),
    (a_study(time_limit="1,5"), "6:13", "time_limit must be a valid number, got '1,5'; a number has a point, 1.5,"),
    (a_study(title="2002"), "1:8", "title must be a valid string, got 2002; in quotes it is text: '2002'"),
    (a_study(title="# 5"), "1:7", "title must be a valid string, got None; text that begins with # needs quotes"),
    (a_study(light="{file: {ldr: yes, file: gone.png}}"), "2:21",
     "light.file.ldr must be a valid boolean, got 'yes'; write true or false"),
    (a_study(reference="0.01"), "6:12", "reference must be a mapping, got 0.01"),
    # Lists and names
    (a_study(plugins="my_method"), "6:10", "plugins must be a valid list, got 'my_method'; write [my_method]"),
    (a_study(plugins="[my_method.py]"), "6:11",
     "plugins[0] must be the dotted name of a module, without .py: my_method"),
    (a_study(exclude="{samples: 4}"), "6:10", "exclude must be a valid list, got {'samples': 4}; begin each of its "),
    (a_study(claims=""), "6:8", "claims must be a valid list, got None; remove a key that has no value"),
    (a_study(metric="rms", plugin="[x]", timelimit="3"), "6:1",
     "unknown key 'metric'; did you mean 'metrics'?; and 'plugin' on line 7; did you mean 'plugins'?; and 'timelimit' "
     "on line 8; did you mean 'time_limit'?"),
    (a_study(methods="{importance_sampling: {sample: 4, sed: 3}}"), "5:33",
     "methods.importance_sampling: unknown option 'sample'; did you mean 'samples'?; and 'sed' on line 5; did you mean "
     "'seed'?"),
    # Tuning
    (a_study(methods="{importance_sampling: {samples: {tune: rms}}}"), "5:42",
     "methods.importance_sampling.samples: only an option that takes fractions can be tuned; sweep this one: a list"),
    (a_study(methods="{regular_sampling: {mip_filter: {tune: rms, range: [0, 1]}}}"), "5:42",
     "methods.regular_sampling.mip_filter: only an option that takes fractions can be tuned"),
    (a_study(methods="{regular_sampling: {mip_bias: {range: [0, 1]}}}"), "5:40",
     "methods.regular_sampling.mip_bias must be a valid number, got {'range': [0, 1]}; to tune it write {tune: "),
    (a_study(methods="{regular_sampling: {mip_bias: [{tune: rms}, 0]}}"), "5:41",
     "methods.regular_sampling.mip_bias[0] must be a valid number, got {'tune': 'rms'}; to tune it write {"),
    (a_study(methods="{regular_sampling: {mip_bias: {tune: rms, range: [0, 1, 2]}}}"), "5:59",
     "methods.regular_sampling.mip_bias.range must have at most 2 items, not 3, got [0, 1, 2]"),
    # Claims and exclusions
    (a_claim("higher: importance_sampling, than: importance_sampling, metric: rms"), "6:10",
     "claims[0] needs one of the keys lower, slope, ratio, value, got none; instead of 'higher' write lower, with the "
     "two sides exchanged"),
    (a_claim("better: importance_sampling, than: importance_sampling, metric: rms"), "6:10",
     "claims[0] needs one of the keys lower, slope, ratio, value, got none; to state that one side has the lower "
     "error, write lower: METHOD, than: METHOD, metric: ERROR"),
    (a_claim("lowr: importance_sampling, than: importance_sampling, metric: rms"), "6:10",
     "claims[0] needs one of the keys lower, slope, ratio, value, got none; did you mean 'lower'?"),
    (a_claim(f"{VALUE}, where: {{light: [[constant]]}}"), "6:83",
     "claims[0].where.light: must be a light, {light: {option: value}}, or a list of these, got ['constant']"),
    (a_claim(f"{VALUE}, where: {{samples: [[[4]]]}}"), "6:75", "claims[0].where fits no cell of importance_sampling"),
    (a_claim(f"{VALUE}, where: {{view: {{sphere: 3}}}}"), "6:82", "claims[0].where.view: must be a view, {view: {"),
    (a_claim(f"{VALUE}, where: {{method: importance_sampling}}"), "6:84",
     "claims[0].where.method: a claim's methods are its sides"),
    (a_claim("lower: [importance_sampling], than: importance_sampling, metric: rms"), "6:27",
     "claims[0].lower must be a method, or {method: {option: value}}; further keys may be light, material and view"),
    (a_claim("lower: {importance_sampling: {}, samples: 4}, than: importance_sampling, metric: rms"), "6:27",
     "claims[0].lower must be a method, or {method: {option: value}}; further keys may be light, material and view; "
     "options go inside: {importance_sampling: {samples: ...}}"),
    (a_claim("value: importance_sampling, of: rms, between: 1"), "6:66",
     "claims[0].between must be [low, high], with null for a missing bound, got 1"),
    (a_study(exclude="[{method: importance_samplin}]"), "6:20",
     "exclude[0].method: no method 'importance_samplin' in this study; did you mean 'importance_sampling'?"),
    (a_study(exclude="[{importance_sampling: {samples: 4}}]"), "6:12",
     "exclude[0]: unknown key 'importance_sampling'; write method: importance_sampling, "
     "with its options as further keys"),
    (a_study(exclude="[{method: [[importance_sampling]]}]"), "6:20",
     "exclude[0].method: must be a method, {method: {option: value}}, or a list of these"),
    (a_study(exclude="[{samples: '4'}]"), "6:11", "exclude[0] fits no cell; they have samples 4, 8"),
]  # fmt: skip


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("GLOSSBENCH_DATA", raising=False)
    return tmp_path


def error_of(name: str) -> str:
    with pytest.raises(InputError) as caught:
        load_study(name)
    return str(caught.value)


@pytest.mark.parametrize(
    ("text", "place", "message"), HINTS, ids=[f"{i} {m[-50:]}" for i, (_, _, m) in enumerate(HINTS)]
)
def test_a_slip_is_one_line_that_says_what_to_write(text, place, message):
    Path("my.yaml").write_text(text)

    said = error_of("my.yaml")

    assert said.startswith(f"my.yaml:{place}: {message}")
    assert "\n" not in said


@pytest.mark.parametrize(
    "written",
    [
        {"reference": "{relative_error: 1e-3}"},
        {"title": "'Roughness: a study'"},
        {"methods": "\n- importance_sampling: {samples: 16}"},
        {"methods": "\n- importance_sampling:\n    samples: [4, 8]"},
        {"exclude": "[{method: importance_sampling, samples: 4}]"},
        {"exclude": "[{light: {constant: {resolution: 8}}, samples: 4}]"},
        {"claims": f"[{{text: A, {VALUE}, where: {{alpha: 0.5}}}}]"},
        {"claims": f"[{{text: A, {VALUE}, where: {{light: {{constant: {{resolution: 8}}}}}}}}]"},
        {"claims": "[{text: A, value: importance_sampling, of: rms, between: [null, 1]}]"},
    ],
)
def test_what_the_hints_say_is_read(written):
    Path("my.yaml").write_text(a_study(**written))

    assert load_study("my.yaml").cells()


@pytest.mark.parametrize("ends", ["\r\n", "\r", "\n"])
def test_a_file_of_any_line_ends_and_with_a_mark_is_read(ends):
    Path("my.yaml").write_bytes(b"\xef\xbb\xbf" + a_study().replace("\n", ends).encode())

    assert len(load_study("my.yaml").cells()) == 2


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ("base", "unknown study 'base'; did you mean 'base.yaml'?"),
        ("base.yml", "cannot read the study 'base.yml': No such file or directory; did you mean 'base.yaml'?"),
        ("bass.yaml", "cannot read the study 'bass.yaml': No such file or directory; did you mean 'base.yaml'?"),
        ("notes.txt", "unknown study 'notes.txt'; the file of that name is not a study: a study ends in .yaml or .yml"),
        ("nothing.yaml", "cannot read the study 'nothing.yaml': No such file or directory"),
    ],
)
def test_the_message_for_a_missing_study_offers_the_file_next_to_it(asked, said):
    Path("base.yaml").write_text(a_study())
    Path("notes.txt").touch()

    assert error_of(asked) == said
