"""A mesh of a USD stage: its points at any time code, as its skeleton, blend shapes and transforms move them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ...errors import MeshError
from .rest import kept_heading, taken_apart
from .skin import skinned, weighed


class Placed(NamedTuple):
    """An instance of a point instancer: the instancer, its place among the instances, and the prototype's own path."""

    instancer: Any
    number: int
    prototype: Any


class Mesh:
    """A mesh that is shown.

    Args:
        prim: of the stage.
        binding: (skeleton query, skinning query) where a skeleton moves it, else None.
        placed: where it is an instance of a point instancer, else None.
    """

    def __init__(self, prim: Any, binding: tuple[Any, Any] | None, placed: Placed | None = None) -> None:
        from pxr import Usd, UsdGeom  # type: ignore[import-not-found]

        self.prim, self.binding, self.placed = prim, binding, placed
        self.mesh, self._time = UsdGeom.Mesh(prim), Usd.TimeCode
        self.path = str(prim.GetPath()) + (f"/{placed.number}" if placed else "")
        self.count = len(self.mesh.GetPointsAttr().Get(Usd.TimeCode.EarliestTime()) or ())
        self._skin: tuple[np.ndarray, np.ndarray] | None = None
        self._lead = np.zeros((0, 0, 4, 4))
        self._xforms = UsdGeom.XformCache()

    @property
    def has_faces(self) -> bool:
        """Whether there is anything of it."""
        return bool(self.count and self.mesh.GetFaceVertexCountsAttr().Get(self._time.EarliestTime()))

    def codes(self) -> set[float]:
        """Time codes at which something that moves it is given."""
        from pxr import UsdGeom

        out = set(self.mesh.GetPointsAttr().GetTimeSamples())
        ends = [self.prim, *([self.placed.instancer.GetPrim()] if self.placed else [])]
        if self.binding is not None:
            query = self.binding[0]
            ends.append(query.GetPrim())
            animation = query.GetAnimQuery()
            if animation:
                out |= set(animation.GetJointTransformTimeSamples()) | set(animation.GetBlendShapeWeightTimeSamples())
        for prim in ends:
            while prim and not prim.IsPseudoRoot():
                if prim.IsA(UsdGeom.Xformable):
                    out |= set(UsdGeom.Xformable(prim).GetTimeSamples())
                prim = prim.GetParent()
        if self.placed:
            instancer = self.placed.instancer
            for attribute in (instancer.GetPositionsAttr(), instancer.GetOrientationsAttr(), instancer.GetScalesAttr()):
                out |= set(attribute.GetTimeSamples())
        return out

    def topology(self, name: str, codes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Corners of each face (f,), and the vertices of all corners (k,).

        Raises:
            MeshError: they change with time, or do not go together.
        """
        attributes = self.mesh.GetFaceVertexCountsAttr(), self.mesh.GetFaceVertexIndicesAttr()
        counts, corners = (np.array(a.Get(self._time.EarliestTime()) or (), dtype=np.int64) for a in attributes)
        for attribute, first in zip(attributes, (counts, corners)):
            for code in attribute.GetTimeSamples():
                if not np.array_equal(np.array(attribute.Get(code)), first):
                    raise MeshError(f"part {name!r}: has other faces at time code {code:g} than before: a body keeps its "
                                    "vertices and faces; export the clip up to there, or leave the part out (only=)")
        if counts.sum() != len(corners):
            raise MeshError(f"part {name!r}: its faces need {counts.sum()} corners, and there are {len(corners)}")
        return counts, corners

    def prepare(self, name: str, notes: list[str]) -> None:
        """Reads the skin's weights, and checks them."""
        scheme = self.mesh.GetSubdivisionSchemeAttr()
        if scheme.HasAuthoredValue() and scheme.Get() != "none":
            notes.append(f"part {name!r}: is the cage of a subdivision surface, and is taken as it is")
        if self.binding is None or not self.binding[1].HasJointInfluences():
            return
        query = self.binding[1]
        rigid = query.IsRigidlyDeformed()
        indices, weights = query.ComputeJointInfluences() if rigid else query.ComputeVaryingJointInfluences(self.count)
        each = query.GetNumInfluencesPerComponent()
        joints, weights = (np.array(part, dtype=np.float64).reshape(-1, each) for part in (indices, weights))
        joints, weights, note = weighed(name, joints, weights, len(self._order()))
        notes += [note] if note else []
        self._skin = joints, weights

    def begin_at_rest(self, code: float, way: np.ndarray, up: int) -> bool:
        """The first frames go from the pose in which its skin was bound to that at a time code, by the parts `way` (k,) of it;
        returns whether it has such a pose.

        Args:
            up: number of the stage's axis that points up.
        """
        if self._skin is None:
            return False
        skeleton, _ = self.binding  # type: ignore[misc]
        bind = np.array([_columns(m) for m in skeleton.GetJointWorldBindTransforms()])
        now = np.array([_columns(m) for m in skeleton.ComputeJointLocalTransforms(self._time(code))])
        above = [skeleton.GetTopology().GetParent(k) for k in range(len(bind))]
        if len(now) != len(bind) or not any(k >= 0 for k in above):
            return False
        world, way = self._world(code), np.append(way, 1.0)
        at = np.empty((len(way), len(bind), 4, 4))
        for k, parent in enumerate(above):  # parents come first
            there = taken_apart(now[k][None])
            if parent < 0:
                at[:, k] = there.matrix()
                continue
            rest = taken_apart((np.linalg.inv(bind[parent]) @ bind[k])[None])
            at[:, k] = at[:, parent] @ rest.on_the_way(there, way).matrix()
        next_ = [k for k, parent in enumerate(above) if parent >= 0 > above[parent]]
        turn = kept_heading(world @ at[:, next_], up)
        self._lead = (np.linalg.inv(world) @ turn @ world)[:-1, None] @ at[:-1] @ np.linalg.inv(bind)
        return True

    def positions(self, name: str, codes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """((1 or frames, n, 3) positions in the world, (frames, 3, 3) turns of its transform) at time codes (frames,)."""
        out, turns = [], []
        for k, code in enumerate(codes.tolist()):
            x = np.array(self._points(name, code), dtype=np.float64).reshape(-1, 3)
            if len(x) != self.count:
                raise MeshError(f"part {name!r}: has {len(x)} vertices at time code {code:g}, and {self.count} at first")
            at = self._world(code)
            if self._skin is not None:
                x = self._skinned(x, code, self._lead[k] if k < len(self._lead) else None)
            out.append(x @ at[:3, :3].T + at[:3, 3])
            turns.append(at[:3, :3])
        return np.stack(out), np.stack(turns)

    def holes(self) -> np.ndarray:
        """(k,) rows of the faces that are holes."""
        return np.array(self.mesh.GetHoleIndicesAttr().Get(self._time.EarliestTime()) or (), dtype=np.int64)

    def left_handed(self) -> bool:
        """Whether its faces go round the other way."""
        return self.mesh.GetOrientationAttr().Get(self._time.EarliestTime()) == "leftHanded"

    def texture(self, corners: np.ndarray, places: np.ndarray) -> np.ndarray | None:
        """(m, 3, 2) texture coordinates of triangles, whose corners are at `places` (m, 3) among those of all faces."""
        from pxr import UsdGeom

        primvars = UsdGeom.PrimvarsAPI(self.prim).FindPrimvarsWithInheritance()
        found = [p for p in primvars if p.HasValue() and str(p.GetTypeName()) in ("texCoord2f[]", "texCoord2d[]", "float2[]")]
        found.sort(key=lambda p: (p.GetPrimvarName() not in ("st", "UVMap"), p.GetPrimvarName() != "st"))
        for primvar in found:
            uv = np.array(primvar.ComputeFlattened(self._time.EarliestTime()), dtype=np.float64).reshape(-1, 2)
            by = {"faceVarying": places, "vertex": corners[places], "varying": corners[places]}.get(primvar.GetInterpolation())
            if by is not None and by.max(initial=-1) < len(uv):
                return uv[by]
        return None

    def groups(self, face: np.ndarray) -> dict[str, np.ndarray]:
        """Rows of triangles by the names of subsets; face: (m,) the face that each triangle is of."""
        from pxr import UsdGeom

        return {subset.GetPrim().GetName(): np.flatnonzero(np.isin(face, np.array(subset.GetIndicesAttr().Get() or ())))
                for subset in UsdGeom.Subset.GetAllGeomSubsets(UsdGeom.Imageable(self.prim))
                if subset.GetElementTypeAttr().Get() == "face"}

    def _points(self, name: str, code: float) -> Any:
        """Its own points, with blend shapes."""
        from pxr import UsdSkel, Vt

        points = self.mesh.GetPointsAttr().Get(self._time(code))
        if points is None:
            points = self.mesh.GetPointsAttr().Get(self._time.EarliestTime())
        if points is None:
            raise MeshError(f"part {name!r}: has no points")
        if self.binding is None or not self.binding[1].HasBlendShapes() or not self.binding[0].GetAnimQuery():
            return points
        shapes = UsdSkel.BlendShapeQuery(UsdSkel.BindingAPI(self.prim))
        weights = self.binding[0].GetAnimQuery().ComputeBlendShapeWeights(self._time(code))
        mapper = self.binding[1].GetBlendShapeMapper()
        mine = mapper.Remap(weights, Vt.FloatArray(shapes.GetNumBlendShapes())) if mapper else weights
        shapes.ComputeDeformedPoints(*shapes.ComputeSubShapeWeights(mine), shapes.ComputeBlendShapePointIndices(),
                                     shapes.ComputeSubShapePointOffsets(), points)
        return points

    def _skinned(self, x: np.ndarray, code: float, lead: np.ndarray | None) -> np.ndarray:
        """(n, 3) points in the skeleton's space, by its joints' transforms at a time code, or by given ones (joints, 4, 4)."""
        from pxr import Vt

        skeleton, query = self.binding  # type: ignore[misc]
        joints, weights = self._skin  # type: ignore[misc]
        transforms = skeleton.ComputeSkinningTransforms(self._time(code))
        if lead is None and query.GetSkinningMethod() == "dualQuaternion" and not query.IsRigidlyDeformed():
            points = Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(x, dtype=np.float32))
            query.ComputeSkinnedPoints(transforms, points, self._time(code))
            return np.array(points, dtype=np.float64)
        bind = _columns(query.GetGeomBindTransform(self._time(code)))
        at = (np.array([_columns(m) for m in transforms]) if lead is None else lead)[self._order()] @ bind
        if len(joints) == 1:
            joints, weights = (np.broadcast_to(part, (len(x), part.shape[1])) for part in (joints, weights))
        return skinned(x[None], joints, weights, at[None])[0]

    def _order(self) -> np.ndarray:
        """Rows of the skeleton's joints in the order of the mesh's own."""
        skeleton, query = self.binding  # type: ignore[misc]
        all_joints = list(skeleton.GetJointOrder())
        own = query.GetJointOrder()
        return np.array([all_joints.index(joint) for joint in own] if own else range(len(all_joints)), dtype=np.int64)

    def _world(self, code: float) -> np.ndarray:
        """(4, 4) from its points, or from its skeleton, to the world, of columns."""
        self._xforms.SetTime(self._time(code))
        if self._skin is not None:
            return _columns(self._xforms.GetLocalToWorldTransform(self.binding[0].GetPrim()))  # type: ignore[index]
        if self.placed is None:
            return _columns(self._xforms.GetLocalToWorldTransform(self.prim))
        instancer, number, prototype = self.placed
        own, reset = self._xforms.ComputeRelativeTransform(self.prim, prototype.GetParent())
        all_of_them = instancer.ComputeInstanceTransformsAtTime(self._time(code), self._time(code),
                                                                instancer.ExcludeProtoXform)
        if number >= len(all_of_them):
            raise MeshError(f"instancer {instancer.GetPrim().GetName()!r}: has {len(all_of_them)} instances at time code "
                            f"{code:g}, and more at first: their number must stay")
        world = self._xforms.GetLocalToWorldTransform(instancer.GetPrim())
        return _columns(world) @ _columns(all_of_them[number]) @ _columns(own)


def meshes_of(stage: Any, notes: list[str]) -> list[Mesh]:
    """All meshes that are shown, instances and skinned ones too."""
    from pxr import Usd, UsdGeom, UsdSkel

    every = Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)
    cache, bound = UsdSkel.Cache(), {}
    for prim in Usd.PrimRange.Stage(stage, every):
        if prim.IsA(UsdSkel.Root):
            root = UsdSkel.Root(prim)
            cache.Populate(root, every)
            for binding in cache.ComputeSkelBindings(root, every):
                for target in binding.GetSkinningTargets():
                    bound[target.GetPrim().GetPath()] = cache.GetSkelQuery(binding.GetSkeleton()), target
    out, hidden = [], []
    walk = iter(Usd.PrimRange.Stage(stage, every))
    for prim in walk:
        if prim.IsA(UsdGeom.PointInstancer):
            walk.PruneChildren()
            out += _instances(UsdGeom.PointInstancer(prim), every)
        elif prim.IsA(UsdGeom.Mesh):
            shown = UsdGeom.Imageable(prim)
            if shown.ComputeVisibility(Usd.TimeCode.EarliestTime()) == "invisible" or shown.ComputePurpose() in (
                    "guide", "proxy"):
                hidden.append(prim.GetName())
            else:
                out.append(Mesh(prim, bound.get(prim.GetPath())))
    if hidden:
        notes.append(f"meshes that are hidden are left out: {', '.join(hidden[:8])}{' ...' if len(hidden) > 8 else ''}")
    return out


def _instances(instancer: Any, every: Any) -> list[Mesh]:
    """The meshes of all instances of a point instancer."""
    from pxr import Usd, UsdGeom

    stage = instancer.GetPrim().GetStage()
    prototypes = [stage.GetPrimAtPath(p) for p in instancer.GetPrototypesRel().GetForwardedTargets()]
    out = []
    for k, which in enumerate(instancer.GetProtoIndicesAttr().Get(Usd.TimeCode.EarliestTime()) or ()):
        for prim in Usd.PrimRange(prototypes[which], every):
            if prim.IsA(UsdGeom.Mesh):
                out.append(Mesh(prim, None, Placed(instancer, k, prototypes[which])))
    return out


def _columns(matrix: Any) -> np.ndarray:
    """(4, 4) of columns, of a matrix of USD, which is of rows."""
    return np.array(matrix, dtype=np.float64).T
