"""Mesh files as programs write them: the same tetrahedron, or the right refusal."""

import base64
import json
import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh

from glossbench.errors import InputError
from glossbench.scene import mesh_files
from glossbench.scene.mesh import make_mesh
from glossbench.scene.mesh_files import identify_mesh, load_mesh, make_named_mesh

CORNERS = np.array([[0.0, 0, 0], [2, 0, 0], [0, 1, 0], [0, 0, 3]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
V = "v 0 0 0\nv 2 0 0\nv 0 1 0\nv 0 0 3\n"
F = "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
TILTED = np.array([0.6, 0.0, 0.8])


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def loaded(name, content):
    Path(name).write_bytes(content if isinstance(content, bytes) else content.encode())
    return load_mesh(name)


def refusal(name, content):
    with pytest.raises(InputError) as caught:
        loaded(name, content)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def triangles(mesh):
    """Corners of all triangles, each from its lowest vertex on, in one order: equal for equal oriented surfaces."""
    corners = mesh.vertices[mesh.faces].round(9) + 0.0
    turned = [min(np.roll(c, k, 0).tolist() for k in range(3)) for c in corners]
    return np.array(sorted(turned))


def assert_same(mesh, other):
    np.testing.assert_allclose(triangles(mesh), triangles(other), atol=1e-6)


TETRAHEDRON = make_mesh(CORNERS, FACES)

# OBJ.

OBJ = {
    "plain": V + F,
    "relative": V + "f -4 -2 -3\nf -4 -3 -1\nf -4 -1 -2\nf -3 -2 -1\n",
    "relative between vertices": "v 0 0 0\nv 2 0 0\nv 0 1 0\nf -3 -1 -2\nv 0 0 3\nf -4 -3 -1\nf -4 -1 -2\nf -3 -2 -1\n",
    "faces before their vertices": F + V,
    "tabs": (V + F).replace(" ", "\t"),
    "blanks at both ends": "".join(f"  {line}  \n" for line in (V + F).splitlines()),
    "a mark at the start": b"\xef\xbb\xbf" + (V + F).encode(),
    "UTF-16": (V + F).encode("utf-16"),
    "Windows lines": (V + F).replace("\n", "\r\n"),
    "lines of the old Macintosh": (V + F).replace("\n", "\r"),
    "no last line end": (V + F).rstrip(),
    "the end mark of DOS": V + F + "\x1a",
    "lines that go on": V + F.replace("f 1 2 4", "f 1 \\\n 2 \\\r\n 4"),
    "comments": "# made by hand \\\n" + V.replace("v 2 0 0", "v 2 0 0 # right") + F.replace("f 1 3 2", "f 1 3 2#first"),
    "textures": V
    + "vt 0 0\n"
    + F.replace(" 1", " 1/1").replace(" 2", " 2/1").replace(" 3", " 3/1").replace(" 4", " 4/1"),
    "an empty texture and normal": V + F.replace(" 1", " 1//").replace(" 2", " 2/"),
    "objects, groups, materials": f"mtllib none.mtl\no a\n{V}g b\nusemtl red\ns off\n"
    + F.replace("f 1 4", "s 1\ng c\nf 1 4"),
    "lines and points": V + F + "l 1 2\np 1\n",
    "colours of vertices": V.replace("v 0 0 3", "v 0 0 3 0.5 0.5 0.5") + F,
    "a weight": V.replace("v 0 0 3", "v 0 0 3 1.0") + F,
    "the old word for a face": V + F.replace("f ", "fo "),
    "letters of another language": "# gr\xfcn\n".encode("latin-1") + (V + F).encode(),
    "numbers with exponents": V.replace("2 0 0", "2.0e+00 0E0 -0.") + F,
}


@pytest.mark.parametrize("name", OBJ)
def test_obj_files_of_all_hands_are_the_same_mesh(name):
    assert_same(loaded("a.obj", OBJ[name]), TETRAHEDRON)


def test_obj_relative_numbers_count_from_the_vertices_so_far():
    block = "v 0 0 {0}\nv 1 0 {0}\nv 0 1 {0}\nf -3 -2 -1\n"

    mesh = loaded("a.obj", "".join(block.format(z) for z in (0, 1, 2)))

    assert sorted(mesh.vertices[mesh.faces][:, :, 2].mean(1)) == [-1, 0, 1]


def test_obj_concave_polygon_has_its_area_and_winding():
    mesh = loaded("a.obj", "v 0 0 0\nv 2 0 0\nv 2 2 0\nv 1 0.2 0\nv 0 2 0\nf 1 2 3 4 5\n")

    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    assert np.cross(b - a, c - a)[:, 2].sum() / 2 == pytest.approx(2.2)
    assert mesh.repairs == ()


def test_obj_normals_belong_to_corners():
    """One position with two normals is two vertices; relative numbers of normals count from the normals so far."""
    sharp = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvn 0 0 1\nf 1//1 2//1 3//1\nvn 0 2 0\nf 1//-1 2//-1 4//-1\n"

    mesh = loaded("a.obj", sharp)

    assert len(mesh.vertices) == 6
    np.testing.assert_array_equal(mesh.normals[mesh.faces[0]], np.tile([0, 0, 1], (3, 1)))
    np.testing.assert_array_equal(mesh.normals[mesh.faces[1]], np.tile([0, 1, 0], (3, 1)))


def test_obj_normals_that_some_faces_lack_are_made():
    assert loaded("a.obj", V + "vn 1 0 0\n" + F.replace("f 1 3 2", "f 1//1 3//1 2//1")) == TETRAHEDRON


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (V + "f 1 2 0\n", "a.obj:5: f needs vertices by number, from 1 or back from the last so far, got '1 2 0'"),
        (
            V + "f -5 -1 -2\n",
            "a.obj:5: f needs vertices by number, from 1 or back from the last so far, got '-5 -1 -2'",
        ),
        (V + "f 1 2 x\n", "a.obj:5: f needs vertices by number, from 1 or back from the last so far, got '1 2 x'"),
        ("# \n\\\nv 0,5 1 2\n", "a.obj:2: v needs three numbers, got '0,5 1 2'"),
        ("v 1 2\n", "a.obj:1: v needs three numbers, got '1 2'"),
        (V + "f 1 2 9\n", "a.obj has 4 vertices, but face 0 has vertex 8, from 0"),
        (V + "f 1//1 2//1 3//1\n", "a.obj has 0 normals, but a face has normal 0, from 0"),
        (V + "f 1 2\n", "a.obj has no faces"),
    ],
)
def test_obj_lines_that_are_wrong_are_named(content, message):
    assert refusal("a.obj", content) == message


# PLY.


def ply(body="ascii", faces=None, *, index="vertex_indices", kind="float", extra=False, lines="\n"):
    """The tetrahedron; body is ascii, < or >."""
    faces = FACES.tolist() if faces is None else faces
    order = {"ascii": "ascii", "<": "binary_little_endian", ">": "binary_big_endian"}[body]
    rows = ["ply", f"format {order} 1.0", "comment made by hand"]
    rows += ["element material 1", "property uchar id"] if extra else []
    rows += [f"element vertex {len(CORNERS)}", *(f"property {kind} {axis}" for axis in "xyz")]
    rows += ["property uchar red"] if extra else []
    rows += [f"element face {len(faces)}"]
    rows += ["property list uchar float texcoord"] if extra else []
    rows += [f"property list uchar int {index}"]
    rows += ["property short flags"] if extra else []
    header = (lines.join([*rows, "end_header"]) + lines).encode()
    number = {"float": "f", "double": "d"}[kind]
    values = [("B", 7)] if extra else []
    for corner in CORNERS:
        values += [(number, x) for x in corner] + ([("B", 9)] if extra else [])
    for face in faces:
        values += [("B", 2), ("f", 0.5), ("f", 0.25)] if extra else []
        values += [("B", len(face)), *(("i", i) for i in face)]
        values += [("h", -3)] if extra else []
    if body == "ascii":
        return header + " ".join(f"{value:g}" for _, value in values).encode() + lines.encode()
    return header + b"".join(struct.pack(body + kind, value) for kind, value in values)


PLY = {
    "text": ply(),
    "text of Windows lines": ply(lines="\r\n"),
    "little endian": ply("<"),
    "little endian, header of Windows lines": ply("<", lines="\r\n"),
    "big endian": ply(">"),
    "the other name of the list": ply(">", index="vertex_index"),
    "doubles": ply("<", kind="double"),
    "elements and properties of other kinds": ply(extra=True),
    "elements and properties of other kinds, binary": ply(">", extra=True),
}


@pytest.mark.parametrize("name", PLY)
def test_ply_files_of_all_hands_are_the_same_mesh(name):
    assert_same(loaded("a.ply", PLY[name]), TETRAHEDRON)


# Beside a triangle a quad and a concave polygon, which a fan from its first corner would leave.
PLATE = np.array([[0, 0, 0], [2, 0, 0], [2, 2, 0], [1, 0.2, 0], [0, 2, 0], [0, -1, 0], [2, -1, 0], [3, 0, 0]])
POLYGONS = [[1, 7, 2], [5, 6, 1, 0], [0, 1, 2, 3, 4]]


@pytest.mark.parametrize("body", ["ascii", "<", ">"])
@pytest.mark.parametrize("extra", [False, True])
def test_ply_of_mixed_polygons_has_the_area_of_all(monkeypatch, body, extra):
    monkeypatch.setitem(globals(), "CORNERS", PLATE)

    mesh = loaded("a.ply", ply(body, POLYGONS, extra=extra))

    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    unit = 1.5  # half of its longest edge
    assert len(mesh.faces) == 6
    assert np.cross(b - a, c - a)[:, 2].sum() / 2 * unit**2 == pytest.approx(2.2 + 2 + 1, rel=1e-6)


@pytest.mark.parametrize("text", [True, False])
def test_ply_strips_are_triangles_of_one_winding(text):
    """Two strips of the list, the second after a -1: a square of four corners, and one triangle more."""
    corners = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0), (2, 0, 0), (2, 1, 0)]
    strip = [0, 1, 2, 3, -1, 1, 4, 3, 5]
    order = "ascii" if text else "binary_little_endian"
    header = f"ply\nformat {order} 1.0\nelement vertex 6\nproperty float x\nproperty float y\nproperty float z\n"
    header += "element tristrips 1\nproperty list int int vertex_indices\nend_header\n"
    numbers = [x for corner in corners for x in corner]
    body = struct.pack("<18f10i", *numbers, len(strip), *strip)
    if text:
        body = " ".join(map(str, [*numbers, len(strip), *strip])).encode()

    mesh = loaded("a.ply", header.encode() + body)

    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    np.testing.assert_allclose(np.cross(b - a, c - a)[:, 2], [1, 1, 1, 1])  # twice the area, its box 2 wide
    assert mesh.repairs == ()


def test_ply_normals_are_kept():
    header = "ply\nformat ascii 1.0\nelement vertex 3\n" + "".join(
        f"property float {n}\n" for n in "x y z nx ny nz".split()
    )
    header += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"

    mesh = loaded("a.ply", header + "0 0 0 3 0 4\n1 0 0 3 0 4\n0 1 0 3 0 4\n3 0 1 2\n")

    np.testing.assert_allclose(mesh.normals, np.tile(TILTED, (3, 1)), atol=1e-15)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "a.ply: not a PLY file: it must begin with the line 'ply'"),
        (ply("<")[:-5], "a.ply: PLY file truncated or damaged: it ends before its 4 rows 'face'"),
        (ply("<")[:-60], "a.ply: PLY file truncated or damaged: it ends before its 4 rows 'vertex'"),
        (ply()[:-6], "a.ply: PLY file truncated or damaged: it ends before its 4 rows 'face'"),
        (ply().replace(b"vertex 4", b"vertex 3000000000"), "it ends before its 3000000000 rows 'vertex'"),
        (ply("<").replace(b"vertex 4", b"vertex 3000000000"), "it ends before its 3000000000 rows 'vertex'"),
        (ply("<").replace(b"face 4", b"face 3000000000"), "it ends before its 3000000000 rows 'face'"),
        (ply().replace(b"format ascii", b"format runes"), "PLY file of format 'runes', must be one of ascii, "),
        (ply().replace(b"float x", b"quad x"), "PLY file whose header cannot be read: 'property quad x'"),
        (ply().replace(b"2 0 0", b"2 o 0"), "PLY file of text that holds more than numbers"),
        (ply().replace(b"float z", b"float w"), "a.ply has no vertices with x, y and z"),
        (ply().replace(b"vertex_indices", b"neighbours"), "a.ply has no faces, only 4 points"),
        (ply(faces=[[0, 1, 4]]), "a.ply has 4 vertices, but face 0 has vertex 4, from 0"),
        (
            ply().replace(b"3 0 2 1", b"3 0 nan 1"),
            "a.ply: PLY file whose face names vertex nan, which is not a whole number",
        ),
        (
            ply().replace(b"3 0 2 1", b"3 0 1.5 1"),
            "a.ply: PLY file whose face names vertex 1.5, which is not a whole number",
        ),
        (ply().replace(b"3 0 2 1", b"nan 0 2 1"), "a.ply: PLY file truncated or damaged"),
    ],
)
def test_ply_files_that_are_damaged_are_refused(content, message):
    assert message in refusal("a.ply", content)


# glTF.


class Gltf:
    """A file under construction: arrays become accessors of one buffer."""

    def __init__(self):
        self.data = b""
        self.tree = {"asset": {"version": "2.0"}, "bufferViews": [], "accessors": []}

    def view(self, data, **more):
        self.data += b"\0" * (-len(self.data) % 4)
        self.tree["bufferViews"].append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data), **more})
        self.data += data
        return len(self.tree["bufferViews"]) - 1

    def accessor(self, array, **more):
        array = np.asarray(array)
        kinds = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
        stated = {"bufferView": self.view(array.tobytes()), "componentType": kinds[array.dtype.str[1:]]}
        stated |= {"count": len(array), "type": "VEC3" if array.ndim == 2 else "SCALAR"}
        self.tree["accessors"].append({**stated, **more})
        return len(self.tree["accessors"]) - 1

    def nodes(self, *primitives, **node):
        self.tree |= {"meshes": [{"primitives": list(primitives)}], "nodes": [{"mesh": 0, **node}]}
        self.tree |= {"scenes": [{"nodes": [0]}], "scene": 0}
        return self

    def text(self, uri=None):
        """A .gltf whose buffer is in the file, or of a name."""
        inline = "data:application/octet-stream;base64," + base64.b64encode(self.data).decode()
        self.tree["buffers"] = [{"byteLength": len(self.data), "uri": uri or inline}]
        return json.dumps(self.tree)

    def binary(self):
        """A .glb."""
        self.tree["buffers"] = [{"byteLength": len(self.data)}]
        tree = json.dumps(self.tree).encode()
        tree += b" " * (-len(tree) % 4)
        data = self.data + b"\0" * (-len(self.data) % 4)
        chunks = struct.pack("<I4s", len(tree), b"JSON") + tree + struct.pack("<I4s", len(data), b"BIN\0") + data
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def tetrahedron(kind="u2", mode=4, indices=None, **node):
    file = Gltf()
    primitive = {"attributes": {"POSITION": file.accessor(CORNERS.astype("f4"))}, "mode": mode}
    primitive["indices"] = file.accessor(np.array(FACES.reshape(-1) if indices is None else indices, kind))
    return file.nodes(primitive, **node)


@pytest.mark.parametrize("kind", ["u1", "u2", "u4"])
def test_gltf_indices_of_all_widths(kind):
    assert_same(loaded("a.gltf", tetrahedron(kind).text()), TETRAHEDRON)
    assert_same(loaded("a.glb", tetrahedron(kind).binary()), TETRAHEDRON)


def test_gltf_without_indices_takes_vertices_in_their_order():
    file = Gltf()
    file.nodes({"attributes": {"POSITION": file.accessor(CORNERS[FACES].reshape(-1, 3).astype("f4"))}})

    assert_same(loaded("a.gltf", file.text()), TETRAHEDRON)


def test_gltf_strips_and_fans_wind_as_their_first_triangle():
    strip = loaded("strip.gltf", tetrahedron(mode=5, indices=[0, 1, 3, 2]).text())
    fan = loaded("fan.gltf", tetrahedron(mode=6, indices=[0, 1, 3, 2]).text())

    assert_same(strip, make_mesh(CORNERS, [[0, 1, 3], [3, 1, 2]]))
    assert_same(fan, make_mesh(CORNERS, [[0, 1, 3], [0, 3, 2]]))


def test_gltf_strips_joined_by_doubled_vertices_have_no_seam():
    joined = loaded("a.gltf", tetrahedron(mode=5, indices=[0, 1, 3, 3, 0, 0, 0, 3, 2]).text())

    assert joined.repairs == ()
    assert_same(joined, make_mesh(CORNERS, [[0, 1, 3], [0, 3, 2]]))


def test_gltf_sparse_numbers_replace_others():
    file = tetrahedron()
    places, values = (
        file.view(np.array([3, 1], "u2").tobytes()),
        file.view(np.array([[0, 0, 5], [4, 0, 0]], "f4").tobytes()),
    )
    file.tree["accessors"][0]["sparse"] = {
        "count": 2,
        "indices": {"bufferView": places, "componentType": 5123},
        "values": {"bufferView": values},
    }

    assert_same(loaded("a.gltf", file.text()), make_mesh([[0, 0, 0], [4, 0, 0], [0, 1, 0], [0, 0, 5]], FACES))


def test_gltf_sparse_numbers_may_stand_on_zeros():
    file = tetrahedron()
    places, values = file.view(bytes([1, 2, 3])), file.view(CORNERS[1:].astype("f4").tobytes())
    del file.tree["accessors"][0]["bufferView"]
    file.tree["accessors"][0]["sparse"] = {
        "count": 3,
        "indices": {"bufferView": places, "componentType": 5121},
        "values": {"bufferView": values},
    }

    assert_same(loaded("a.gltf", file.text()), TETRAHEDRON)


def test_gltf_vertices_that_lie_between_others_are_found_by_their_stride():
    file = tetrahedron()
    both = np.zeros(4, [("position", "<f4", 3), ("normal", "<f4", 3)])
    both["position"], both["normal"] = CORNERS, TILTED
    view = file.view(both.tobytes(), byteStride=24)
    normal = {"bufferView": view, "byteOffset": 12, "componentType": 5126, "count": 4, "type": "VEC3"}
    file.tree["accessors"] += [{**normal, "byteOffset": 0}, normal]
    file.tree["meshes"][0]["primitives"][0]["attributes"] = {"POSITION": 2, "NORMAL": 3}

    mesh = loaded("a.gltf", file.text())

    assert_same(mesh, TETRAHEDRON)
    np.testing.assert_allclose(mesh.normals, np.tile(TILTED, (4, 1)), atol=1e-7)


def test_gltf_quantized_positions_are_numbers_up_to_one():
    file = Gltf()
    position = file.accessor((CORNERS / 3 * 32767).round().astype("i2"), normalized=True)
    file.tree |= {"extensionsUsed": ["KHR_mesh_quantization"], "extensionsRequired": ["KHR_mesh_quantization"]}
    primitive = {"attributes": {"POSITION": position}, "indices": file.accessor(FACES.reshape(-1).astype("u2"))}
    file.nodes(primitive)
    file.tree["meshes"] += [{"primitives": [primitive]}]
    file.tree["nodes"] = [{"mesh": 0, "scale": [3, 3, 3]}, {"mesh": 1, "scale": [3, 3, 3], "translation": [2, 0, 0]}]
    file.tree["scenes"] = [{"nodes": [0, 1]}]

    mesh = loaded("a.gltf", file.text())

    both = make_mesh(np.r_[CORNERS, CORNERS + np.eye(3)[0] * 2], np.r_[FACES, FACES + 4])
    np.testing.assert_allclose(triangles(mesh), triangles(both), atol=1e-4)  # 16 bits


HALF = 0.5**0.5
PLACED = {
    "translation": ({"translation": [5, 6, 7]}, lambda v: v + np.array([5, 6, 7]), 1),
    "rotation": ({"rotation": [0, 0, HALF, HALF]}, lambda v: v @ [[0, 1, 0], [-1, 0, 0], [0, 0, 1]], 1),
    "scale": ({"scale": [1, 2, 3]}, lambda v: v * [1, 2, 3], 1),
    "mirror": ({"scale": [-1, 1, 1]}, lambda v: v * [-1, 1, 1], -1),
    "three mirrors": ({"scale": [-1, -1, -1]}, lambda v: -v, -1),
    "two mirrors": ({"scale": [-1, -1, 1]}, lambda v: v * [-1, -1, 1], 1),
    "matrix": ({"matrix": [2, 0, 0, 0, 1, 1, 0, 0, 0, 0, -1, 0, 9, 8, 7, 1]},
               lambda v: v @ [[2, 0, 0], [1, 1, 0], [0, 0, -1]], -1),
}  # fmt: skip


@pytest.mark.parametrize("name", PLACED)
def test_gltf_nodes_place_their_mesh_and_what_is_mirrored_still_winds_outwards(name):
    node, place, sign = PLACED[name]

    mesh = loaded("a.gltf", tetrahedron(**node).text())

    assert_same(mesh, make_mesh(place(CORNERS), FACES[:, ::sign]))
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    assert np.einsum("nk,nk->", a, np.cross(b, c)) > 0  # its volume, outwards


@pytest.mark.parametrize("scale", [[-1, 1, 1], [2, 1, -0.5]])
def test_gltf_normals_of_a_mirrored_node_stay_on_the_outside(scale):
    """Those of a ball, which is then an ellipsoid: n along p / scale^2."""
    ball = trimesh.creation.icosphere(2)
    file = Gltf()
    attributes = {name: file.accessor(np.array(ball.vertices, "f4")) for name in ("POSITION", "NORMAL")}
    file.nodes({"attributes": attributes, "indices": file.accessor(ball.faces.reshape(-1).astype("u2"))}, scale=scale)

    mesh = loaded("a.gltf", file.text())

    expected = mesh.vertices / np.array(scale) ** 2
    np.testing.assert_allclose(mesh.normals, expected / np.linalg.norm(expected, axis=1, keepdims=True), atol=1e-6)
    assert (
        np.einsum("fk,fk->f", mesh.face_normals(np.arange(len(mesh.faces))), mesh.normals[mesh.faces[:, 0]]) > 0
    ).all()


def test_gltf_children_stand_on_their_parents_and_other_scenes_are_left_out():
    file = tetrahedron()
    file.tree["nodes"] = [
        {"children": [1], "translation": [0, 0, 9]},
        {"mesh": 0, "scale": [2, 2, 2], "children": [2]},
        {"mesh": 0, "translation": [1, 0, 0]},
        {"mesh": 0, "translation": [100, 0, 0]},
    ]
    file.tree |= {"scenes": [{"nodes": [3]}, {"nodes": [0]}], "scene": 1}

    expected = make_mesh(np.r_[CORNERS * 2, (CORNERS + np.eye(3)[0]) * 2], np.r_[FACES, FACES + 4])
    assert_same(loaded("a.gltf", file.text()), expected)


def test_gltf_points_and_lines_are_left_out():
    file = tetrahedron()
    file.tree["meshes"][0]["primitives"] += [{"attributes": {"POSITION": 0}, "mode": mode} for mode in (0, 1, 2, 3)]

    assert_same(loaded("a.gltf", file.text()), TETRAHEDRON)


def changed(change, binary=False):
    file = tetrahedron()
    change(file.tree)
    return file.binary() if binary else file.text()


def extension(name, required=True, bare=True):
    def change(tree):
        tree["extensionsUsed"] = [name]
        if required:
            tree["extensionsRequired"] = [name]
        tree["meshes"][0]["primitives"][0]["extensions"] = {name: {}}
        if bare:
            del tree["accessors"][0]["bufferView"]

    return change


DRACO = "KHR_draco_mesh_compression"
MESHOPT = "EXT_meshopt_compression"
UNREAD = "glTF file with {}, which is not read; export it without this extension"
WRONG = {
    "Draco": (changed(extension(DRACO)), UNREAD.format(f"{DRACO} (compressed by Draco)")),
    "Draco that is not required": (
        changed(extension("KHR_draco_mesh_compression", required=False)),
        UNREAD.format("KHR_draco_mesh_compression (compressed by Draco)"),
    ),
    "meshopt": (changed(extension(MESHOPT, bare=False)), UNREAD.format(f"{MESHOPT} (compressed by meshopt)")),
    "copies": (changed(extension("EXT_mesh_gpu_instancing", bare=False)), UNREAD.format("EXT_mesh_gpu_instancing")),
    "version 1": (changed(lambda tree: tree.update(asset={"version": "1.0"})), "glTF file of version 1.0, must be 2.0"),
    "points alone": (tetrahedron(mode=0).text(), "a.gltf has no triangles"),
    "a buffer that is not there": (
        tetrahedron().text("gone.bin"),
        "its buffer 'gone.bin' cannot be read: No such file",
    ),
    "a buffer of the net": (
        tetrahedron().text("https://example.org/a.bin"),
        "whose buffer is at 'https://example.org/a.bin'",
    ),
    "a buffer too short": (
        tetrahedron().text("data:;base64,AAAA"),
        "a buffer in the file itself has 3 bytes, must have 72",
    ),
    "no base64": (tetrahedron().text("data:;base64,?"), "whose buffer is not base64"),
    "numbers beyond the buffer": (
        changed(lambda tree: tree["accessors"][0].update(count=400)),
        "numbers up to byte 4800 of a buffer of 72",
    ),
    "numbers that lie within each other": (
        changed(lambda tree: tree["bufferViews"][0].update(byteStride=4)),
        "items of 12 bytes are 4 bytes apart",
    ),
    "a claim of numbers": (
        changed(lambda tree: (tree["accessors"][0].update(count=1 << 40), tree["accessors"][0].pop("bufferView"))),
        "1099511627776 items without data, more than 134217728",
    ),
    "no position": (
        changed(lambda tree: tree["meshes"][0]["primitives"][0].update(attributes={})),
        "has no 'POSITION'",
    ),
    "a circle of nodes": (
        changed(lambda tree: tree["nodes"][0].update(children=[0])),
        "nodes are children of each other",
    ),
    "half a file": (tetrahedron().text()[:200], "its JSON cannot be read"),
    "half a GLB": (tetrahedron().binary()[:-9], "GLB file truncated"),
    "a list": ("[1]", "its JSON is not a mapping"),
}


@pytest.mark.parametrize("name", WRONG)
def test_gltf_files_that_are_not_read_say_why(name):
    content, message = WRONG[name]

    assert message in refusal("a.gltf", content)


def test_gltf_with_a_compression_that_has_a_way_around_it_is_read():
    content = changed(extension("KHR_draco_mesh_compression", required=False, bare=False))

    assert_same(loaded("a.gltf", content), TETRAHEDRON)


def test_gltf_buffer_in_another_file_may_have_blanks_in_its_name():
    file = tetrahedron()
    Path("my file.bin").write_bytes(file.data)

    assert_same(loaded("a.gltf", file.text("my%20file.bin")), TETRAHEDRON)


# STL.


def test_stl_text_and_binary_are_the_same_mesh():
    corners = CORNERS[FACES]
    facets = "".join(
        "facet normal 0 0 0\n outer loop\n"
        + "".join(f"  vertex {x} {y} {z}\n" for x, y, z in triangle)
        + " endloop\nendfacet\n"
        for triangle in corners
    )
    binary = b"solid, but binary".ljust(80) + struct.pack("<I", 4)
    binary += b"".join(struct.pack("<12fH", 0, 0, 0, *triangle.reshape(-1), 0) for triangle in corners)

    for content in (f"solid a\n{facets}endsolid a\n", f"SOLID A\r\n{facets}ENDSOLID A\r\n", binary):
        assert_same(loaded("a.stl", content), TETRAHEDRON)
    assert refusal("a.stl", binary[:-7]).startswith("a.stl: STL file truncated: it ends without 'endsolid'")
    assert refusal("a.stl", b"x" + binary[1:-7]) == (
        "a.stl: STL file truncated or damaged: 277 bytes, but 4 triangles need 284"
    )
    assert refusal("a.stl", f"solid a\n{facets}") == "a.stl: STL file truncated: it ends without 'endsolid'"


# The meaning of a name.


def test_the_meaning_of_a_gltf_file_is_that_of_its_buffers_too():
    file = tetrahedron()
    Path("a.gltf").write_text(file.text("a.bin"))
    Path("a.bin").write_bytes(file.data)
    before, mesh = identify_mesh("a.gltf"), make_named_mesh("a.gltf")

    Path("a.bin").write_bytes(file.data[:-24] + np.array(FACES[:, ::-1], "u2").tobytes())

    assert identify_mesh("a.gltf") != before
    assert make_named_mesh("a.gltf") != mesh


@pytest.mark.parametrize("suffix", ["obj", "ply", "glb", "gltf", "stl"])
def test_a_huge_file_is_refused_by_its_size_before_it_is_read(monkeypatch, suffix):
    """3 GB of nothing, which take no room on the disk."""
    with Path(f"a.{suffix}").open("wb") as file:
        file.truncate(3 << 30)
    monkeypatch.setattr(Path, "read_bytes", lambda path: pytest.fail("it was read"))

    for read in (load_mesh, identify_mesh, make_named_mesh):
        with pytest.raises(
            InputError, match=rf"^a\.{suffix}: a mesh.* must have at most 1073741824 bytes, got 3221225472"
        ):
            read(f"a.{suffix}")


def test_a_mesh_file_is_looked_for_below_the_folder_of_data(tmp_path, monkeypatch):
    (tmp_path / "data" / "meshes").mkdir(parents=True)
    (tmp_path / "data" / "meshes" / "a.obj").write_text(V + F)
    monkeypatch.setenv("GLOSSBENCH_DATA", str(tmp_path / "data"))

    assert make_named_mesh("a.obj") == TETRAHEDRON
    assert mesh_files.identify_mesh("a.obj") == identify_mesh(str(tmp_path / "data" / "meshes" / "a.obj"))
