"""A segmenter that knows the truth and errs as trackers do: a double of SAM2 at the level of masks."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter

from phys4dgen.grouping.sam2.segmenter import Proposal
from phys4dgen.render.cameras import orbit_camera
from phys4dgen.render.views import render_label_maps


class Oracle:
    """Offers and follows the true parts, with planted errors.

    Attributes:
        truth: part of every pixel of every view, -1 for background, shape [V, H, W].
        started: true part of each mask that was followed, in the order of the ids.
        followed: per id, the true part that it shows by view.
    """

    def __init__(self, truth, *, seed=0, wrong=0.1, switches=0.3, lose_below=0.15):
        self.rng = np.random.default_rng(seed)
        self.truth = truth
        self.part_count = int(truth.max()) + 1
        self.shown = self._with_wrong_pixels(wrong)
        self.switches, self.lose_below = switches, lose_below
        self.area = np.array([[(view == part).sum() for part in range(self.part_count)] for view in truth])
        self.started: list[int] = []
        self.followed: list[dict[int, int]] = []
        self.switched = self.lost = 0

    def _with_wrong_pixels(self, share):
        """Half of the wrong pixels are specks, half lie together in blobs."""
        shown = self.truth.copy()
        for view in shown:
            foreground = view >= 0
            if not foreground.any():
                continue
            other = self.rng.integers(0, self.part_count, view.shape)
            blobs = gaussian_filter(self.rng.normal(size=view.shape), 3)
            limit = np.quantile(blobs[foreground], 1 - share / 2)
            specks = self.rng.random(view.shape) < share / 2
            blob_label = int(self.rng.integers(0, self.part_count))
            view[foreground & (blobs > limit)] = blob_label
            view[foreground & specks] = other[foreground & specks]
        return shown

    def propose(self, view, region):
        """Every part in the region, and the region as a whole, which is the best mask of all."""
        found = [Proposal((self.shown[view] == part) & region, 0.9) for part in range(self.part_count)]
        return [Proposal(region.copy(), 0.99), *(proposal for proposal in found if proposal.mask.any())]

    def segment(self, view, *, points, box):
        if points is None:
            points = [[(box[0] + box[2]) / 2, (box[1] + box[3]) / 2]]
        x, y = np.asarray(points)[0].astype(int)
        return Proposal(self.shown[view] == self.truth[view, y, x], 0.9)

    def track(self, view, masks):
        followed = [self._main_part(view, mask) for mask in masks]
        first = len(self.started)
        self.started += followed
        self.followed += [{view: part} for part in followed]
        yield view, np.stack([np.where(mask, 5.0, -5.0) for mask in masks]).astype(np.float32)
        for order in (range(view + 1, len(self.truth)), range(view - 1, -1, -1)):
            now = list(followed)
            gone = [False] * len(masks)
            turn = [
                self.rng.choice(order) if len(order) and self.rng.random() < self.switches / 2 else None for _ in masks
            ]
            for other in order:
                logits = np.full((len(masks), *self.truth.shape[1:]), -5.0, np.float32)
                for number in range(len(masks)):
                    if other == turn[number]:
                        visible = [p for p in range(self.part_count) if self.area[other, p] and p != now[number]]
                        if visible:
                            now[number] = int(self.rng.choice(visible))
                            self.switched += 1
                    part = now[number]
                    if self.area[other, part] < self.lose_below * self.area[:, part].max():
                        self.lost += not gone[number]
                        gone[number] = True  # behind the object, and never found again
                    if not gone[number]:
                        logits[number][self.shown[other] == part] = 3.0 + self.rng.random()
                        self.followed[first + number][other] = part
                yield other, logits

    def _main_part(self, view, mask):
        return int(np.bincount(self.truth[view][mask & (self.truth[view] >= 0)], minlength=self.part_count).argmax())


def true_maps(gaussians, labels, cameras):
    """The part that each pixel of each view shows; floaters show nothing."""
    maps = render_label_maps(gaussians, np.where(labels >= 0, labels, labels.max() + 1), cameras)
    return np.where(maps > labels.max(), -1, maps)


def random_cameras(gaussians, rotation, *, count, size_px, seed=0):
    """Cameras anywhere above -30 deg, in random order."""
    rng = np.random.default_rng(seed)
    lower, upper = gaussians.robust_bounds(rotation=rotation)
    return [
        orbit_camera(
            azimuth_deg=rng.uniform(0, 360),
            elevation_deg=float(np.degrees(np.arcsin(rng.uniform(-0.5, 1)))),
            target=(lower + upper) / 2 @ rotation,
            rotation=rotation,
            radius=1.2 * float(np.linalg.norm(upper - lower)),
            fovy_deg=49.1,
            width=size_px,
            height=size_px,
        )
        for _ in range(count)
    ]
