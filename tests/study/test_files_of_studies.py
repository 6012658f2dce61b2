"""Files that a study names: where they are looked for, opened, and how a bare name of one is written."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

import glossbench as gb
from glossbench.brdf.measured import cornell
from glossbench.commands.cli import app
from glossbench.errors import InputError
from glossbench.run import references
from glossbench.run.runner import run_study
from glossbench.study.cells import to_text
from glossbench.study.study import load_study
from glossbench.truth.reference import compute_reference

CUBE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
FITS = (
    "# fits\n"
    "paint = Aggregate(Lambertian(albedo = [0.1, 0.2, 0.3]), NganWard(albedo = [0.1, 0.1, 0.1], roughness = 0.2))\n"
)
STUDY = """title: T
light: LIGHT
material: MATERIAL
view: VIEW
methods: {importance_sampling: {samples: 4}}
reference: {relative_error: 0.2}
metrics: [rms]
"""


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    """Called from another folder than the study's, which has a file of each kind."""
    folder, elsewhere = tmp_path / "study", tmp_path / "elsewhere"
    folder.mkdir()
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    monkeypatch.delenv("GLOSSBENCH_DATA", raising=False)
    (folder / "cube.obj").write_text(CUBE)
    (folder / "paint.fit").write_text(FITS)
    (folder / "goniometer.brdf").write_text(measurement())
    (folder / "probe.pfm").write_bytes(b"PF\n4 2\n-1.0\n" + b"\0\0\x80\x3f" * 24)
    return folder


def measurement():
    """Samples of a grey Lambertian surface at all pairs of 0, 40 and 80 degrees."""
    wavelengths = range(400, 701, 10)
    rows = [f"{i} 0 {o} {phi} " + "0.1 " * 31 for i in (0, 0.7, 1.4) for o in (0, 0.7, 1.4) for phi in (0, 1.5, 3.1)]
    return "\n".join(["31", " ".join(map(str, wavelengths)), *rows])


def study(folder, light="constant", material="{ggx: {alpha: 0.5}}", view="{sphere: {resolution: 4}}"):
    path = folder / "s.yaml"
    path.write_text(STUDY.replace("LIGHT", light).replace("MATERIAL", material).replace("VIEW", view))
    return path


def message_of(path, **options):
    with pytest.raises(InputError) as caught:
        load_study(path, **options)
    message = str(caught.value)
    assert "\n" not in message
    return message.removeprefix(f"{path}:")


NAMED = {
    "light": ("probe.pfm", "{file: {file: probe.pfm}}"),
    "material": ("goniometer.brdf", "{measured: {file: goniometer.brdf}}"),
    "view": ("cube.obj", "{mesh: {shape: cube.obj}}"),
}


@pytest.mark.parametrize("kind", NAMED)
def test_a_bare_name_of_a_file_next_to_the_study_is_an_item(here, kind):
    bare, spelled = (load_study(study(here, **{kind: text})) for text in NAMED[kind])

    assert bare == spelled
    assert str(here / NAMED[kind][0]) in to_text(getattr(bare, f"{kind}s")[0])


@pytest.mark.parametrize("kind", NAMED)
def test_a_bare_name_in_a_list_and_with_options_is_one_too(here, kind):
    more = {"light": "scale: 2", "material": "samplers: ward", "view": "resolution: 16"}[kind]
    name = NAMED[kind][0]

    items = getattr(load_study(study(here, **{kind: f"[{name}, {{{name}: {{{more}}}}}]"})), f"{kind}s")

    assert len(items) == 2
    assert all(str(here / name) in to_text(item) for item in items)


def test_a_mesh_and_a_table_next_to_the_study_are_run(here):
    path = study(here, material="{ngan: {file: paint.fit, material: paint}}",
                 view="{mesh: {shape: cube.obj, resolution: 4}}")  # fmt: skip

    results = run_study(load_study(path), Path("results"))

    assert results.cells["status"].tolist() == ["done"]
    assert str(here / "cube.obj") in results.cells["view_options"].iloc[0]


def test_python_takes_bare_names_too(here):
    assert gb.material(str(here / "goniometer.brdf")).name == "measured"
    assert gb.material(str(here / "paint.fit"), material="paint").build_fit().m == (0.2, 0.2)
    assert gb.view(str(here / "cube.obj"), resolution=4).mask().any()


@pytest.mark.parametrize(
    ("items", "message"),
    [
        ({"material": "[gone.brdf]"}, "3:12: material[0].file: no BRDF file 'gone.brdf': not in "),
        ({"material": "{measured: {file: gone.bsdf}}"}, "3:29: material.measured.file: no BRDF file 'gone.bsdf'"),
        ({"material": "{ngan: {file: gone.fit, material: a}}"}, "3:25: material.ngan.file: no table of fits"),
        ({"view": "gone.obj"}, "4:7: view.shape: no mesh file 'gone.obj': not in "),
        ({"view": "{mesh: {shape: [torus_knot, gone.ply]}}"}, "4:35: view.mesh.shape[1]: no mesh file 'gone.ply'"),
        ({"material": "{file: goniometer.brdf}"},
         "3:12: material: unknown material 'file'; write goniometer.brdf, or measured: {file: goniometer.brdf}"),
        ({"material": "{measured: goniometer.brdf}"},
         "options must be a mapping, got 'goniometer.brdf'; write measured: {file: goniometer.brdf}"),
        ({"view": "{mesh: cube.obj}"}, "options must be a mapping, got 'cube.obj'; write mesh: {shape: cube.obj}"),
        ({"view": "{file: cube.obj}"}, "unknown view 'file'; write cube.obj, or mesh: {shape: cube.obj}"),
        ({"material": "probe.pfm"},
         "unknown material 'probe.pfm'; a file that is a material ends in .brdf, .binary, .bsdf, .fit"),
        ({"view": "probe.pfm"},
         "unknown view 'probe.pfm'; a file that is a view ends in .obj, .ply, .glb, .gltf, .stl"),
        ({"material": "paint.fit"}, "3:11: material: option 'material' is required"),
        ({"material": "{ngan: {file: paint.fit, material: pain}}"}, "has no 'pain'; did you mean 'paint'?"),
    ],
)  # fmt: skip
def test_a_file_that_is_missing_or_written_another_way_is_one_line_with_its_place(here, items, message):
    assert message in message_of(study(here, **items))


BROKEN = {
    "an image": ("light", "bad.pfm", b"PF\n4 2\n-1.0\n", "2:8: light.file: "),
    "an image of nowhere": ("light", "bad.pfm", b"PF\n7 1\n-1.0\n" + b"\0\0\x80\x3f" * 21, "2:8: light.file: "),
    "a mesh": ("view", "bad.obj", b"v 0 0 0\nf 1 2 3\n", "4:7: view.shape: "),
    "a measurement": ("material", "bad.brdf", b"31 400", "3:11: material.file: "),
    "a tensor file": ("material", "bad.bsdf", b"tensor_file\0", "3:11: material.file: "),
    "a MERL file": ("material", "bad.binary", b"\0" * 100, "3:11: material.file: "),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_file_is_found_when_files_are_opened(here, name):
    kind, file, content, message = BROKEN[name]
    (here / file).write_bytes(content)
    path = study(here, **{kind: file})

    load_study(path)
    assert message in message_of(path, open_files=True)


def test_the_broken_file_of_several_is_named(here):
    (here / "bad.obj").write_bytes(b"v 0 0 0\n")
    path = study(here, view="{mesh: {shape: [cube.obj, torus_knot, bad.obj]}}")

    assert message_of(path, open_files=True).startswith("4:45: view.mesh.shape[2]: ")


def test_validate_opens_the_files_and_a_run_writes_nothing_before(here):
    (here / "bad.obj").write_bytes(b"v 0 0 0\n")
    path = study(here, view="bad.obj")

    validated = CliRunner().invoke(app, ["validate", str(path)])

    assert isinstance(validated.exception, InputError)
    with pytest.raises(InputError, match=r"bad\.obj has no faces"):
        run_study(load_study(path), Path("results"))
    assert not Path("results").exists()


@pytest.mark.parametrize("name", ["a.brdf", "a.binary", "a.bsdf"])
def test_a_huge_measurement_is_refused_by_its_size_before_it_is_read(here, monkeypatch, name):
    """3 GB of nothing, which take no room on the disk."""
    with (here / name).open("wb") as file:
        file.truncate(3 << 30)
    for reader in ("read_bytes", "read_text"):
        monkeypatch.setattr(Path, reader, lambda path, **how: pytest.fail("it was read"))

    for ask in ("key", "open_files"):
        with pytest.raises(
            InputError, match=rf"{name}: a BRDF file must have at most 1073741824 bytes, got 3221225472"
        ):
            getattr(gb.material(str(here / name)), ask)()


def test_a_long_text_is_not_a_measurement(here, monkeypatch):
    monkeypatch.setattr(cornell, "MAX_BYTES", 100)

    with pytest.raises(InputError, match=r"goniometer\.brdf: a goniometer file must have at most 100 bytes, got \d+"):
        gb.material(str(here / "goniometer.brdf")).open_files()


def test_a_file_replaced_while_its_cell_is_measured_stops_the_run_and_leaves_no_reference(here, monkeypatch):
    loaded = load_study(study(here, view="{cube.obj: {resolution: 4}}"))

    def replacing(*arguments):
        (here / "cube.obj").write_text(CUBE.replace("v 0 0 1", "v 0 0 2"))
        return compute_reference(*arguments)

    with monkeypatch.context() as patched:
        patched.setattr(references, "compute_reference", replacing)
        with pytest.raises(InputError, match="a file of mesh has changed while the study ran; run it again"):
            run_study(loaded, Path("results"))

    assert not list(Path("results/references").glob("*.json"))
    again = run_study(load_study(study(here, view="{cube.obj: {resolution: 4}}")), Path("results"))
    assert again.cells["status"].tolist() == ["done"]
