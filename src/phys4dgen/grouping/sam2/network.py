"""SAM2 through Transformers: the one file that knows ``Sam2VideoModel``, parts of which are no public interface.

Ravi et al., "SAM 2: Segment Anything in Images and Videos" (2024). Written and tested against transformers 5.23. Every
view is encoded once; all sessions share its features. Late objects get a session of their own, because a session that
has begun to track takes no objects in (facebookresearch/sam2, issue 224).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.grouping.sam2.cost import MODEL_TYPE
from phys4dgen.grouping.sam2.preprocess import network_mask, network_picture, picture_logits
from phys4dgen.grouping.sam2.proposals import DEFAULT_CHOICE, Choice, chosen_proposals
from phys4dgen.grouping.sam2.segmenter import Proposal
from phys4dgen.weights import load_model

if TYPE_CHECKING:
    import torch  # pyright: ignore[reportMissingImports]

__all__ = ["Sam2Network", "Sam2Segmenter"]

_PROMPTS_AT_ONCE = 16
"""Point prompts decoded together: more take gigabytes and are no faster on a CPU."""
_STABLE_OFFSET = 1.0
"""A mask is stable if it hardly changes between the thresholds +1 and -1 (Kirillov et al. 2023)."""
_HIDDEN = -1024.0
"""Logit of an object that the network says is not in the view (its own NO_OBJ_SCORE)."""


class Sam2Network:
    """A loaded checkpoint."""

    def __init__(self, folder: Path, *, device: str = "cpu") -> None:
        """Load it.

        Args:
            folder: with config.json and safetensors (``weights_folder``).
            device: of PyTorch.

        Raises:
            StageError: the folder holds another model.
        """
        from transformers import Sam2VideoModel  # pyright: ignore[reportMissingImports]

        model = load_model(Sam2VideoModel, folder, model="SAM2", model_type=MODEL_TYPE, device=device)
        self.model: Any = model
        self.device: torch.device = model.device
        size = model.config.image_size
        self.size: int = size if isinstance(size, int) else size[0]

    def encode(self, rgb: NDArray[np.uint8]) -> tuple[list[torch.Tensor], torch.Tensor]:
        """Features of a picture [H, W, 3], finest first, and the position encoding of the coarsest."""
        import torch  # pyright: ignore[reportMissingImports]

        with torch.inference_mode():
            found = self.model.get_image_features(network_picture(rgb, self.size).to(self.device))
        return list(found.fpn_hidden_states), found.fpn_position_encoding[-1]


class Sam2Segmenter:
    """SAM2 on one sequence of views.

    Attributes:
        features: of every view that has been encoded.
    """

    def __init__(
        self,
        network: Sam2Network,
        frames: NDArray[np.uint8],
        *,
        choice: Choice = DEFAULT_CHOICE,
        on_view: Callable[[int], None] | None = None,
    ) -> None:
        """Encode all views.

        Args:
            network: the checkpoint.
            frames: V views in the order of a smooth path, shape [V, H, W, 3].
            choice: which of the network's masks are taken.
            on_view: called with the number of views encoded.
        """
        self._network, self._choice = network, choice
        self._height, self._width = frames.shape[1:3]
        self.features: list[list[torch.Tensor]] = []
        self._position: torch.Tensor | None = None
        for done, frame in enumerate(frames, start=1):
            features, position = network.encode(frame)
            self.features.append(features)
            if self._position is None:  # the same for all views; the finer levels' are never read
                self._position = position
            if on_view is not None:
                on_view(done)

    def propose(self, view: int, region: NDArray[np.bool_]) -> list[Proposal]:
        """Masks from a grid of point prompts in a region; see ``Segmenter``."""
        import torch  # pyright: ignore[reportMissingImports]

        xy = self._choice.grid(region)
        masks: list[NDArray[np.bool_]] = []
        quality: list[float] = []
        for start in range(0, len(xy), _PROMPTS_AT_ONCE):
            points = self._network_points(xy[start : start + _PROMPTS_AT_ONCE])[None, :, None]  # [1, P, 1, 2]
            with torch.inference_mode():
                logits, iou = self._decode(view, points=points, box=None)
                inner = (logits > _STABLE_OFFSET).sum((1, 2))
                outer = (logits > -_STABLE_OFFSET).sum((1, 2)).clamp(min=1)
                good = (iou >= self._choice.min_quality) & (inner / outer >= self._choice.min_stability)
                if good.any():
                    large = picture_logits(logits[good], self._height, self._width) > 0
                    masks += list(large.cpu().numpy())
                    quality += iou[good].tolist()
        return chosen_proposals(masks, quality, region, choice=self._choice)

    def segment(self, view: int, *, points: NDArray[np.float64] | None, box: NDArray[np.float64] | None) -> Proposal:
        """The mask of what a person points at; see ``Segmenter``."""
        import torch  # pyright: ignore[reportMissingImports]

        prompt = None if points is None else self._network_points(points)[None, None]  # [1, 1, K, 2]
        corners = None if box is None else self._network_points(box.reshape(2, 2)).reshape(1, 1, 4)
        with torch.inference_mode():
            logits, iou = self._decode(view, points=prompt, box=corners)
            best = int(iou.argmax())
            mask = picture_logits(logits[best : best + 1], self._height, self._width)[0] > 0
        return Proposal(mask.cpu().numpy(), float(iou[best]))

    def track(self, view: int, masks: Sequence[NDArray[np.bool_]]) -> Iterator[tuple[int, NDArray[np.float32]]]:
        """Follow masks both ways in a session of their own; see ``Segmenter``."""
        session = self._session()
        for number, mask in enumerate(masks):
            session.add_mask_inputs(session.obj_id_to_idx(number), view, network_mask(mask, self._network.size))
        session.obj_with_new_inputs = list(range(len(masks)))  # the model empties the list that it is given
        yield view, self._step(session, view, reverse=False)
        for reverse, order in (False, range(view + 1, len(self.features))), (True, range(view - 1, -1, -1)):
            for other in order:
                yield other, self._step(session, other, reverse=reverse)
                self._forget(session, other, view, reverse=reverse)

    def _step(self, session: Any, view: int, *, reverse: bool) -> NDArray[np.float32]:
        import torch  # pyright: ignore[reportMissingImports]

        found = self._network.model(session, frame_idx=view, reverse=reverse)
        with torch.inference_mode():
            shown = found.object_score_logits.reshape(-1, 1, 1) > 0
            logits = torch.where(shown, found.pred_masks[:, 0].float(), _HIDDEN)
            return picture_logits(logits, self._height, self._width).cpu().numpy()

    def _forget(self, session: Any, view: int, start: int, *, reverse: bool) -> None:
        """Drop what no later step reads: a third of a gigabyte per object in 29 views.

        A step reads the conditioning view and the ``max_object_pointers_in_encoder`` views behind it, which at the turn
        are the first ones after ``start``.
        """
        reach = self._network.model.config.max_object_pointers_in_encoder
        for outputs in session.output_dict_per_obj.values():
            tracked = outputs["non_cond_frame_outputs"]
            tracked[view].pop("high_res_masks", None)
            tracked[view].pop("pred_masks", None)
            outputs["cond_frame_outputs"][start].pop("high_res_masks", None)
            for old in list(tracked):
                if (old > view + reach) if reverse else (start + reach < old < view - reach):
                    del tracked[old]

    def _session(self) -> Any:
        """A tracking session whose cache holds the features of all views."""
        import torch  # pyright: ignore[reportMissingImports]
        from transformers.models.sam2_video.modeling_sam2_video import (  # pyright: ignore[reportMissingImports]
            Sam2VideoInferenceSession,
        )

        count, device = len(self.features), self._network.device
        session = Sam2VideoInferenceSession(
            video=torch.zeros(count, 0),  # pixels are read only where features are missing
            video_height=self._height,
            video_width=self._width,
            inference_device=device,
            inference_state_device=device,
            video_storage_device=device,
            dtype=torch.float32,
            max_vision_features_cache_size=count + 1,
        )
        for view, features in enumerate(self.features):
            session.cache.cache_vision_features(view, {"vision_feats": features, "vision_pos_embeds": [self._position]})
        return session

    def _decode(
        self, view: int, *, points: torch.Tensor | None, box: torch.Tensor | None
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Logits [M, h, w] and estimated IoUs [M] of three masks for each of P prompts on a single view."""
        import torch  # pyright: ignore[reportMissingImports]

        model = self._network.model
        *fine, coarse = self.features[view]
        maps = [
            level.permute(1, 2, 0).reshape(1, -1, *size)
            for level, size in zip(
                [*fine, coarse + model.no_memory_embedding], model.backbone_feature_sizes, strict=True
            )
        ]
        labels = None if points is None else torch.ones(points.shape[:3], dtype=torch.int, device=points.device)
        sparse, dense = model.prompt_encoder(
            input_points=points, input_labels=labels, input_boxes=box, input_masks=None
        )
        logits, iou, *_ = model.mask_decoder(
            image_embeddings=maps[-1],
            image_positional_embeddings=model.get_image_wide_positional_embeddings(),
            sparse_prompt_embeddings=sparse,
            dense_prompt_embeddings=dense,
            multimask_output=True,
            high_resolution_features=maps[:-1],
        )
        return logits.flatten(0, 2).float(), iou.flatten().float()

    def _network_points(self, xy: NDArray[np.float64]) -> torch.Tensor:
        """Pixels of the view as pixels of the network's square input, shape [K, 2]."""
        import torch  # pyright: ignore[reportMissingImports]

        scale = self._network.size / np.array([self._width, self._height])
        return torch.from_numpy((xy * scale).astype(np.float32)).to(self._network.device)
