"""Views from below that look into an object through its missing underside.

A captured object stands on something, so nobody saw its underside. From below one then looks past the rim onto the
inner face of the skin, and carving would empty the object. Such views are left out (ARCHITECTURE.md 2, Views).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, KDTree, QhullError

from phys4dgen.interior.normals import oriented_points
from phys4dgen.types import Gaussians, Views

__all__ = ["views_that_judge"]

_BASE_REL = 0.03  # of the height: what lies so low belongs to the base
_LEAST_COVERED = 0.9
_SAMPLES = 24
_SOLID_OPACITY = 0.3
_MASK_ALPHA = 0.5
_ON_EDGE = 1e-9  # of the size of the hull: what lies so near its edge counts as inside


def views_that_judge(
    gaussians: Gaussians, views: Views, *, rotation: NDArray[np.float64], tolerance: float
) -> NDArray[np.bool_]:
    """Views that carving may use, [V]: all but those from below that see an open bottom.

    The footprint is the convex hull of what stands on the ground. A view from below is left out when more than a tenth
    of the footprint shows the back of a surface that views from above see from its front.

    Args:
        gaussians: the object.
        views: rendered views with alpha and median depth.
        rotation: input axes -> upright axes, [3, 3].
        tolerance: of depths, input units.
    """
    lower, upper = gaussians.robust_bounds(rotation=rotation)
    base = float(lower[2] + _BASE_REL * (upper[2] - lower[2]))
    eyes = np.stack([camera.position for camera in views.cameras]) @ rotation.T
    judge = np.ones(len(views), bool)
    below = np.flatnonzero(eyes[:, 2] < lower[2])
    means = gaussians.means[gaussians.opacities > _SOLID_OPACITY].astype(np.float64) @ rotation.T
    footprint = _footprint(means[means[:, 2] < base], float(lower[2]))
    if len(below) == 0 or len(footprint) == 0:
        return judge
    looked_at = {k: _surface_seen(footprint, views, int(k), rotation) for k in below}
    deeper = {k: points[points[:, 2] > base] for k, points in looked_at.items()}
    doubtful = [k for k in below if len(deeper[k]) > (1 - _LEAST_COVERED) * len(footprint)]
    if not doubtful:
        return judge
    above = np.flatnonzero(eyes[:, 2] > upper[2])
    outside = oriented_points(gaussians, views, rotation=rotation, tolerance=tolerance, chosen=above)
    if len(outside.index) == 0:
        return judge
    tree = KDTree(outside.position)
    for k in doubtful:
        distance, near = tree.query(deeper[k], distance_upper_bound=3 * tolerance)
        found = np.isfinite(distance)
        near = np.asarray(near)[found]
        back = ((eyes[k] - deeper[k][found]) * outside.normal[near]).sum(1) < 0
        judge[k] = back.sum() <= (1 - _LEAST_COVERED) * len(footprint)
    return judge


def _footprint(standing: NDArray[np.float64], height: float) -> NDArray[np.float64]:
    """Points [F, 3] all over the convex hull of what stands on the ground, at its height."""
    if len(standing) < 4:
        return np.zeros((0, 3))
    try:
        edges = ConvexHull(standing[:, :2]).equations
    except QhullError:  # all on one line
        return np.zeros((0, 3))
    steps = [np.linspace(standing[:, a].min(), standing[:, a].max(), _SAMPLES) for a in (0, 1)]
    plane = np.stack(np.meshgrid(*steps, indexing="ij"), -1).reshape(-1, 2)
    plane = plane[(plane @ edges[:, :2].T + edges[:, 2] <= _ON_EDGE * np.ptp(standing[:, :2])).all(1)]
    return np.column_stack([plane, np.full(len(plane), height)])


def _surface_seen(
    targets: NDArray[np.float64], views: Views, view: int, rotation: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The surface points (upright axes) that one view shows in the direction of the targets, where it shows any."""
    camera = views.cameras[view]
    pixels, depth = camera.project(targets @ rotation)
    column, row = np.floor(pixels.T).astype(np.int64)
    inside = (depth > 0) & (column >= 0) & (row >= 0) & (column < camera.width) & (row < camera.height)
    row, column, targets, depth = row[inside], column[inside], targets[inside], depth[inside]
    shown = views.alpha[view, row, column] > _MASK_ALPHA
    stretch = views.depth[view, row, column][shown] / depth[shown]
    eye = rotation @ camera.position
    return eye + stretch[:, None] * (targets[shown] - eye)
