"""STL, OBJ, PLY and GLB files."""

import json
import struct
import subprocess
import sys
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import trimesh

import vpframe as vp
from tests.vpframe.importers.tessellated import plate, soup
from vpframe.importers.mesh_files import weld
from vpframe.scene import modelling as m


def test_welding_joins_what_single_precision_parts_and_no_more():
    rng = np.random.default_rng(2)
    points = rng.uniform(size=(50, 3))
    spread = np.concatenate([points, points + 1e-8, points + 1e-5])
    corners = rng.permutation(150)[:147].reshape(-1, 3)
    vertices, triangles = weld(spread, corners)
    assert vertices[triangles] == pytest.approx(spread[corners], abs=1e-7)
    near = {(i % 50, i >= 100) for i in np.unique(corners)}
    assert len(vertices) == len(near)


def obj_of(shape: vp.Shape, line: str, path: Path) -> Path:
    """An OBJ file with each face under a line of its own."""
    text = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in shape.mesh.vertices]
    for s in range(shape.mesh.n_surfaces):
        text.append(line.format(s))
        text += ["f " + " ".join(str(v + 1) for v in t) for t in shape.mesh.triangles[shape.mesh.triangles_of(s)]]
    path.write_text("\n".join(text) + "\n")
    return path


@pytest.mark.parametrize("line", ["g face_{}", "usemtl paint_{}", "o body_{}"])
def test_groups_of_an_obj_file_are_surfaces(tmp_path, line):
    truth = m.shape(m.box(0.1, 0.1, 0.01) - m.cylinder(0.004, 0.01).translated(0.05, 0.05))
    scene = vp.load(obj_of(truth, line, tmp_path / "plate.obj"))
    (part,) = scene.parts
    assert part.name == "plate"
    assert part.shape.closed
    assert len(part.surfaces) == 7
    assert sorted(s.geometry.kind for s in part.surfaces) == ["cylinder"] + ["plane"] * 6


def test_closed_objects_of_an_obj_file_are_parts(tmp_path):
    a, b = m.shape(m.box(0.1, 0.1, 0.1)), m.shape(m.cylinder(0.05, 0.1).translated(0.3))
    text, start = [], 1
    for name, shape in (("block", a), ("round", b)):
        text.append(f"o {name}")
        text += [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in shape.mesh.vertices]
        text += ["f " + " ".join(str(v + start) for v in t) for t in shape.mesh.triangles]
        start += len(shape.mesh.vertices)
    (tmp_path / "two.obj").write_text("\n".join(text))
    scene = vp.load(tmp_path / "two.obj")
    assert sorted(scene.names) == ["block", "round"]
    assert [len(scene[n].surfaces) for n in ("block", "round")] == [6, 3]


def test_the_nodes_of_a_glb_are_parts_that_share_shapes(tmp_path):
    mesh = soup(m.shape(m.cylinder(0.01, 0.05)))
    mesh.visual = trimesh.visual.TextureVisuals(
        material=trimesh.visual.material.PBRMaterial(baseColorFactor=[255, 0, 0, 255])
    )
    scene = trimesh.Scene()
    scene.add_geometry(mesh, node_name="pin_0", geom_name="pin")
    for i in (1, 2):
        scene.graph.update(f"pin_{i}", matrix=trimesh.transformations.translation_matrix([i, 0, 0]), geometry="pin")
    scene.graph.update("wide", matrix=np.diag([-2.0, 1.0, 1.0, 1.0]), geometry="pin")
    scene.export(tmp_path / "a.glb")
    read = vp.load(tmp_path / "a.glb")
    assert set(read.names) == {"pin_0", "pin_1", "pin_2", "wide"}
    assert len({id(p.shape) for p in read.parts}) == 2
    assert read["pin_2"].pose.translation == pytest.approx([2.0, 0.0, 0.0])
    assert read["pin_0"].color == pytest.approx((1.0, 0.0, 0.0, 1.0))
    assert read["wide"].shape.volume == pytest.approx(2 * read["pin_0"].shape.volume, rel=1e-6)
    assert read["wide"].shape.volume > 0.0


BOX = trimesh.creation.box((0.1, 0.2, 0.3))


PRIMITIVE = {"attributes": {"POSITION": 0}, "indices": 1}


def write_glb(path: Path, **tree) -> Path:
    """A box as GLB, with what `tree` puts in the place of its JSON's entries."""
    vertices, faces = BOX.vertices.astype("<f4").tobytes(), BOX.faces.astype("<u4").tobytes()
    text = json.dumps(
        {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": list(range(len(tree.get("nodes", [0]))))}],
            "nodes": [{"mesh": 0, "name": "box"}],
            "meshes": [{"name": "m", "primitives": [PRIMITIVE]}],
            "accessors": [
                {"bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC3"},
                {"bufferView": 1, "componentType": 5125, "count": 36, "type": "SCALAR"},
            ],
            "bufferViews": [
                {"buffer": 0, "byteOffset": 0, "byteLength": 96},
                {"buffer": 0, "byteOffset": 96, "byteLength": 144},
            ],
            "buffers": [{"byteLength": 240}],
            **tree,
        }
    ).encode()
    text += b" " * (-len(text) % 4)
    data = vertices + faces
    head = struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(data)) + struct.pack("<I4s", len(text), b"JSON")
    path.write_bytes(head + text + struct.pack("<I4s", len(data), b"BIN\0") + data)
    return path


@pytest.fixture
def no_detector(monkeypatch):
    """As where charset_normalizer, which nothing here declares, is not installed."""
    monkeypatch.setitem(sys.modules, "charset_normalizer", None)


@pytest.mark.parametrize("form", ["obj", "stl", "stl_ascii", "ply", "ply_ascii"])
def test_text_in_latin_1_is_read(tmp_path, no_detector, form):
    kind, _, ascii_form = form.partition("_")
    options = {"encoding": "ascii"} if kind == "ply" and ascii_form else {}
    whole = trimesh.exchange.export.export_mesh(BOX, None, form if kind == "stl" else kind, **options)
    whole = whole.encode() if isinstance(whole, str) else whole
    name = "Gehäuse".encode("latin-1")
    data = {
        "obj": lambda: b"# " + name + b"\n" + whole,
        "stl": lambda: name + whole[len(name) :],
        "stl_ascii": lambda: whole.replace(b"solid", b"solid " + name, 1),
    }.get(form, lambda: whole.replace(b"\nelement", b"\ncomment " + name + b"\nelement", 1))()
    assert name in data
    (tmp_path / f"a.{kind}").write_bytes(data)
    (part,) = vp.load(tmp_path / f"a.{kind}", unit="m").parts
    assert part.shape.volume == pytest.approx(0.006, rel=1e-6)


def test_names_and_colours_in_latin_1_are_kept(tmp_path, no_detector):
    two = "".join(f"v {x} {y} {z}\n" for x, y, z in BOX.vertices)
    faces = "".join("f {} {} {}\n".format(*(f + 1)) for f in BOX.faces)
    far = "".join(f"v {x + 1} {y} {z}\n" for x, y, z in BOX.vertices)
    other = "".join("f {} {} {}\n".format(*(f + 9)) for f in BOX.faces)
    text = f"mtllib a.mtl\no Gehäuse\n{two}usemtl Grün\n{faces}o Deckel\n{far}usemtl Rot\n{other}"
    (tmp_path / "a.obj").write_bytes(text.encode("latin-1"))
    (tmp_path / "a.mtl").write_bytes("newmtl Grün\nKd 0.2 0.6 0.2\nnewmtl Rot\nKd 0.8 0.2 0.2\n".encode("latin-1"))
    scene = vp.load(tmp_path / "a.obj", unit="m")
    assert set(scene.names) == {"Gehäuse_Grün", "Deckel_Rot"}
    assert scene["Gehäuse_Grün"].color == pytest.approx((0.2, 0.6, 0.2, 1.0))


@pytest.mark.parametrize(("given", "drawn"), [(0.2140411, 0.5), (0.0508761, 0.25), (1.0, 1.0), (0.0, 0.0)])
def test_colours_of_a_glb_file_are_linear(tmp_path, given, drawn):
    """Values by IEC 61966-2-1; the reader keeps a byte of each."""
    material = {"pbrMetallicRoughness": {"baseColorFactor": [given, 1.0, 0.0, 0.5]}}
    meshes = [{"primitives": [{**PRIMITIVE, "material": 0}]}]
    (part,) = vp.load(write_glb(tmp_path / "a.glb", meshes=meshes, materials=[material])).parts
    assert part.color == pytest.approx((drawn, 1.0, 0.0, 0.5), abs=0.01)
    (plain,) = vp.load(write_glb(tmp_path / "b.glb", meshes=meshes, materials=[{"pbrMetallicRoughness": {}}])).parts
    assert plain.color == pytest.approx((1.0, 1.0, 1.0, 1.0))


def test_what_a_glb_file_holds_beside_triangles_is_named(tmp_path):
    line = {"attributes": {"POSITION": 0}, "mode": 1}
    meshes = [
        {"primitives": [PRIMITIVE]},
        {"name": "cloud", "primitives": [{**line, "mode": 0}]},
        {"name": "wire", "primitives": [line, {**line, "mode": 3}, {**line, "mode": 6}]},
    ]
    nodes = [{"mesh": i, "name": f"node {i}"} for i in range(3)]
    scene = vp.load(write_glb(tmp_path / "a.glb", meshes=meshes, nodes=nodes))
    assert len(scene) == 1
    assert [note.split(";")[0] for note in scene.notes] == [
        "mesh cloud: primitives of points left out (1)",
        "mesh wire: primitives of lines left out (2)",
        "mesh wire: triangle fans left out (1)",
    ]


def test_parts_of_one_mesh_of_a_glb_file_have_the_same_names_each_time(tmp_path):
    path = write_glb(tmp_path / "a.glb", meshes=[{"primitives": [PRIMITIVE, PRIMITIVE]}])
    assert vp.load(path).names == vp.load(path).names == ("box_1", "box_2")


def test_a_mesh_inside_out_is_turned_and_an_open_one_named(tmp_path):
    box = trimesh.creation.box((10.0, 10.0, 10.0))
    box.invert()
    box.export(tmp_path / "a.stl")
    part = vp.load(tmp_path / "a.stl")["a"]
    assert part.shape.volume == pytest.approx(1e-6, rel=1e-6)
    assert any("inside out" in note for note in part.shape.notes)
    trimesh.Trimesh(box.vertices, box.faces[:-1], process=False).export(tmp_path / "b.stl")
    part = vp.load(tmp_path / "b.stl")["b"]
    assert not part.shape.closed
    assert any("open" in note for note in part.shape.notes)


def doubled(faces: np.ndarray, how: str) -> np.ndarray:
    return {
        "all": np.vstack([faces, faces]),
        "turned": np.vstack([faces, faces[:, [1, 2, 0]], faces[:, [2, 0, 1]]]),
        "some": np.vstack([faces, faces[3:8], faces[5:6]]),
        "backs": np.vstack([faces, faces[:, ::-1]]),
        "backs twice": np.vstack([faces, faces[:, ::-1], faces, faces[:, ::-1]]),
    }[how]


@pytest.mark.parametrize(
    ("how", "note"),
    [
        ("all", "12 triangles that the file has twice dropped"),
        ("turned", "24 triangles that"),
        ("some", "6 triangles that"),
        ("backs", "backs dropped"),
        ("backs twice", "24 triangles that"),
    ],
)
@pytest.mark.parametrize("form", ["stl", "obj", "ply", "glb"])
def test_triangles_that_are_there_twice_are_dropped_and_counted(tmp_path, form, how, note):
    faces = doubled(BOX.faces, how)
    trimesh.Trimesh(BOX.vertices, faces, process=False).export(tmp_path / f"a.{form}")
    (part,) = vp.load(tmp_path / f"a.{form}", **({} if form == "glb" else {"unit": "m"})).parts
    assert part.mesh.n_triangles == 12 and part.shape.closed
    assert part.shape.volume == pytest.approx(0.006, rel=1e-6)
    assert any(note in line for line in part.shape.notes)


def test_a_wall_between_two_blocks_of_one_mesh_is_kept_and_noted(tmp_path):
    left, right = trimesh.creation.box((1.0, 1.0, 1.0)), trimesh.creation.box((1.0, 1.0, 1.0))
    right.apply_translation((1.0, 0.0, 0.0))
    wall = np.flatnonzero(right.face_normals[:, 0] < -0.5)
    faces = right.faces.copy()
    other = left.faces[np.flatnonzero(left.face_normals[:, 0] > 0.5)]
    place = {tuple(v): i for i, v in enumerate(right.vertices.tolist())}
    faces[wall] = [[place[tuple(left.vertices[k])] for k in t[::-1]] for t in other]
    right = trimesh.Trimesh(right.vertices, faces, process=False)
    trimesh.util.concatenate([left, right]).export(tmp_path / "a.stl")
    (part,) = vp.load(tmp_path / "a.stl", unit="m").parts
    assert part.shape.volume == pytest.approx(2.0, rel=1e-6)
    assert any("2 triangles have their back" in note for note in part.shape.notes)


def test_a_face_wound_the_other_way_is_noted(tmp_path):
    faces = BOX.faces.copy()
    faces[4] = faces[4][::-1]
    trimesh.Trimesh(BOX.vertices, faces, process=False).export(tmp_path / "a.stl")
    (part,) = vp.load(tmp_path / "a.stl").parts
    assert not part.shape.closed and any("wound the wrong way" in note for note in part.shape.notes)


@pytest.mark.parametrize("names", [["a"] * 3, ["a", "b", "a", "b"], ["a", "a_2", "a"], ["", "", ""]])
@pytest.mark.parametrize("material", [False, True])
def test_objects_of_one_name_of_an_obj_file_are_parts(tmp_path, names, material):
    text = ["mtllib a.mtl"]
    for i, name in enumerate(names):
        text += [f"v {x + i} {y} {z}" for x, y, z in BOX.vertices]
        text += [f"o {name}", *([f"usemtl m{i % 2}"] if material else [])]
        text += ["f {} {} {}".format(*(f + 1 + 8 * i)) for f in BOX.faces]
    (tmp_path / "a.obj").write_text("\n".join(text))
    (tmp_path / "a.mtl").write_text("newmtl m0\nKd 1 0 0\nnewmtl m1\nKd 0 1 0\n")
    scene = vp.load(tmp_path / "a.obj", unit="m")
    assert len(scene) == len(names)
    assert sum(p.shape.volume for p in scene.parts) == pytest.approx(0.006 * len(names), rel=1e-6)
    assert all(name.isprintable() for name in scene.names)
    assert sorted(name[:1] for name in scene.names if name != "a") <= sorted(name[:1] or "a" for name in names)


def test_open_objects_of_one_name_of_an_obj_file_are_parts(tmp_path):
    text = []
    for i in range(3):
        text += [f"v {x + i} {y} {z}" for x, y, z in BOX.vertices] + ["o lid"]
        text += ["f {} {} {}".format(*(f + 1 + 8 * i)) for f in BOX.faces[:-2]]
    (tmp_path / "a.obj").write_text("\n".join(text))
    scene = vp.load(tmp_path / "a.obj", unit="m")
    assert len(scene) == 3 and not any(part.shape.closed for part in scene.parts)


@pytest.mark.parametrize("required", [3, None, "KHR_x", {"a": 1}, [None, 2]])
def test_required_extensions_of_a_glb_file_that_are_no_names_are_passed_over(tmp_path, required):
    assert len(vp.load(write_glb(tmp_path / "a.glb", extensionsRequired=required))) == 1


@pytest.mark.parametrize("mesh", ["x", None, [0], 0.5, True, {"mesh": 0}])
def test_a_node_of_a_glb_file_whose_mesh_is_no_number_is_noted(tmp_path, mesh):
    nodes = [{"mesh": 0, "name": "box"}, {"mesh": mesh, "name": "odd"}]
    try:
        scene = vp.load(write_glb(tmp_path / "a.glb", nodes=nodes))
    except vp.LoadError as error:
        assert "\n" not in str(error)
    else:
        assert scene.names == ("a",)
        assert any("odd is left out: its mesh is" in note for note in scene.notes)


@pytest.mark.parametrize("nodes", [[0], [0, "1"], [0, None]])
def test_a_node_of_a_glb_file_outside_its_scene_is_noted(tmp_path, nodes):
    both = [{"mesh": 0, "name": "box"}, {"mesh": 0, "name": "odd"}]
    try:
        scene = vp.load(write_glb(tmp_path / "a.glb", nodes=both, scenes=[{"nodes": nodes}]))
    except vp.LoadError as error:
        assert "\n" not in str(error)
    else:
        assert scene.names == ("a",) and any("odd is left out" in note for note in scene.notes)


def test_zero_area_triangles_are_dropped_and_counted(tmp_path):
    box = trimesh.creation.box((10.0, 10.0, 10.0))
    flat = np.vstack([box.faces, [[0, 0, 1], [3, 5, 3]]])
    trimesh.Trimesh(box.vertices, flat, process=False).export(tmp_path / "a.stl")
    part = vp.load(tmp_path / "a.stl")["a"]
    assert part.mesh.n_triangles == 12
    assert part.shape.closed
    assert any("2 triangles of zero area" in note for note in part.shape.notes)


def outline(name: str, n: int) -> np.ndarray:
    """A polygon (n, 2) with reflex corners, m, counter-clockwise."""
    a = 2.0 * np.pi * np.arange(n) / n
    if name == "star":
        return (0.05 - 0.02 * (np.arange(n) % 2))[:, None] * np.column_stack([np.cos(a), np.sin(a)])
    if name == "comb":
        x = np.arange(n // 2) * 1e-3
        top = np.column_stack([x, 0.01 + 0.01 * (np.arange(n // 2) % 2)])
        return np.vstack([np.column_stack([x, 0.0 * x]), top[::-1]])
    spiral = np.linspace(0.0, 3.0 * np.pi, n // 2)
    way = np.column_stack([np.cos(spiral), np.sin(spiral)])
    return np.vstack([way * (0.02 + 0.004 * spiral)[:, None], (way * (0.012 + 0.004 * spiral)[:, None])[::-1]])


@pytest.mark.parametrize("n", [10, 200])
@pytest.mark.parametrize("name", ["star", "comb", "spiral"])
@pytest.mark.parametrize("reference", ["{}", "{}//1", "-{}"])
def test_polygons_of_an_obj_file_that_are_not_convex_are_triangulated(tmp_path, name, n, reference):
    """Ends of a prism with reflex corners: every triangle has the polygon's sense, and their areas are its area."""
    flat = outline(name, n)
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    vertices = np.vstack([np.column_stack([flat, 0.0 * flat[:, 0] + z]) for z in (0.0, 0.01)]) @ turn.T
    i = np.arange(n)
    faces = [i[::-1], i + n, *np.column_stack([i, np.roll(i, -1), np.roll(i, -1) + n, i + n])]
    lines = [f"v {x:.12f} {y:.12f} {z:.12f}\n" for x, y, z in vertices]
    number = (lambda k: 2 * n - k) if reference.startswith("-") else (lambda k: k + 1)
    lines += ["vn 0 0 1\n", *("f " + " ".join(reference.format(number(int(k))) for k in face) + "\n" for face in faces)]
    (tmp_path / "a.obj").write_text("".join(lines))
    (part,) = vp.load(tmp_path / "a.obj", unit="m").parts
    x, y = flat.T
    area = 0.5 * (x @ np.roll(y, -1) - y @ np.roll(x, -1))
    assert part.shape.closed and part.shape.volume == pytest.approx(0.01 * area, rel=1e-6)
    corners = part.mesh.vertices[part.mesh.triangles]
    vectors = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) @ turn
    ends = np.abs(vectors[:, 2]) > 0.9 * np.linalg.norm(vectors, axis=1)
    assert np.abs(vectors[ends, 2]).sum() == pytest.approx(2.0 * area, rel=1e-6)
    assert not [note for note in part.shape.notes if "cross" in note]


def test_a_polygon_of_an_obj_file_that_crosses_itself_is_noted(tmp_path):
    corners = [(0, 0), (4, 0), (4, 4), (1, 4), (1, -2), (0, -2)]
    lines = [f"v {x}e-2 {y}e-2 0\n" for x, y in corners]
    (tmp_path / "a.obj").write_text("".join([*lines, "f 1 2 3 4 5 6\n"]))
    scene = vp.load(tmp_path / "a.obj", unit="m")
    assert any("1 polygons cross themselves" in note for note in scene.all_notes())


def test_a_binary_stl_is_read_without_trimesh(tmp_path):
    """The same part as trimesh reads."""
    mesh = soup(m.shape(plate()))
    mesh.export(tmp_path / "a.stl")
    theirs = trimesh.load_mesh(tmp_path / "a.stl", process=False)
    code = (
        "import sys; from pathlib import Path; from vpframe.importers import mesh_files as f; "
        "from vpframe.importers.raw import RawScene; "
        "(piece,) = f._load(Path(sys.argv[1]), 'stl', RawScene()); assert 'trimesh' not in sys.modules; "
        "print(piece.vertices[piece.triangles].tolist())"
    )
    done = subprocess.run([sys.executable, "-c", code, tmp_path / "a.stl"], capture_output=True, text=True, check=True)
    assert np.array_equal(json.loads(done.stdout), theirs.vertices[theirs.faces])


@pytest.mark.parametrize("repeat", [1, 3000])
@pytest.mark.parametrize("shift", [0.0, 1e-9])
def test_vertices_that_fall_together_are_welded_however_many(repeat, shift):
    corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    moved = np.tile(corners, (repeat, 1)) + shift * np.linspace(-1.0, 1.0, 3 * repeat)[:, None]
    tracemalloc.start()
    vertices, triangles = weld(moved, np.arange(3 * repeat).reshape(-1, 3))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(vertices) == 3 and len(triangles) == repeat
    assert peak < 3e7
