"""Edges of a mesh against those of the kernel's B-rep."""

import numpy as np
import pytest
from OCP.BRep import BRep_Tool
from OCP.BRepAdaptor import BRepAdaptor_Curve
from OCP.collections import IndexedDataMap_TopoDS_Shape_List_TopoDS_Shape_TopTools_ShapeMapHasher as AncestorMap
from OCP.GeomAbs import GeomAbs_CurveType
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopExp import TopExp
from OCP.TopoDS import TopoDS

from vpframe.scene import modelling as m

SOLIDS = [
    m.box(0.01, 0.02, 0.03),
    m.cylinder(0.01, 0.02),
    m.cone(0.01, 0.004, 0.02).rotated([1, 2, 3], 0.5),
    m.box(0.1, 0.1, 0.01) - m.cylinder(0.01, 0.02).translated(0.05, 0.05),
    m.box(0.1, 0.08, 0.02).filleted(0.004),
    m.hexagon(0.02, 0.01).chamfered(0.001),
]


@pytest.mark.parametrize("solid", SOLIDS)
def test_edges_are_those_of_the_b_rep(solid):
    beside = AncestorMap()
    kinds = TopAbs_ShapeEnum.TopAbs_EDGE, TopAbs_ShapeEnum.TopAbs_FACE
    TopExp.MapShapesAndAncestors_s(solid.occ, *kinds, beside)
    lengths, radii = [], []
    for i in range(1, beside.Extent() + 1):
        edge = TopoDS.Edge(beside.FindKey(i))
        faces = list(beside.FindFromIndex(i))
        if BRep_Tool.Degenerated_s(edge) or len(faces) < 2 or faces[0].IsSame(faces[1]):  # a pole, a seam
            continue
        curve = BRepAdaptor_Curve(edge)
        ends = [curve.Value(t) for t in (curve.FirstParameter(), curve.LastParameter())]
        lengths.append(1e-3 * ends[0].Distance(ends[1]))
        if curve.GetType() == GeomAbs_CurveType.GeomAbs_Circle and lengths[-1] < 1e-9:
            radii.append(1e-3 * curve.Circle().Radius())
    shape = m.shape(solid)
    found = [float(np.linalg.norm(edge.points[0] - edge.points[-1])) for edge in shape.edges]
    assert sorted(found) == pytest.approx(sorted(lengths), abs=1e-9)
    assert all(len(edge.surfaces) == 2 for edge in shape.edges)
    whole = [e.circle[2] for e in shape.edges if e.circle is not None and (e.points[0] == e.points[-1]).all()]
    assert sorted(whole) == pytest.approx(sorted(radii), rel=1e-9)
    for edge in shape.edges:
        for side in edge.surfaces:
            corners = shape.mesh.vertices[np.unique(shape.mesh.triangles[shape.mesh.triangles_of(side)])]
            assert (np.abs(edge.points[:, None] - corners[None]).max(axis=2).min(axis=1) == 0.0).all()
