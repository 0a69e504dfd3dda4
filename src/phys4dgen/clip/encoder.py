"""A CLIP checkpoint: the one file that knows ``CLIPModel``.

The paper uses ViT-B/16 (Sec. 3.4). Only the parts of Transformers that need no torchvision are used.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.errors import StageError
from phys4dgen.weights import load_model

__all__ = ["DEFAULT_CLIP", "ClipEncoder"]

DEFAULT_CLIP = "openai/clip-vit-base-patch16"
_PICTURES_AT_ONCE, _SENTENCES_AT_ONCE = 16, 64
_MAX_TOKENS = 77


class ClipEncoder:
    """A loaded checkpoint.

    Attributes:
        name: of the checkpoint, for reports.
        temperature: by which cosines are divided before a softmax, as learned.
    """

    def __init__(self, folder: Path, *, name: str, device: str = "cpu") -> None:
        """Load it.

        Args:
            folder: with configuration, safetensors, image processor and tokenizer (``weights_folder``).
            name: for reports.
            device: of PyTorch.

        Raises:
            StageError: the folder holds another model, or lacks a file.
        """
        from transformers import (  # pyright: ignore[reportMissingImports]
            CLIPImageProcessorPil,
            CLIPModel,
            CLIPTokenizer,
        )

        self._model: Any = load_model(CLIPModel, folder, model="CLIP", model_type="clip", device=device)
        try:
            self._processor: Any = CLIPImageProcessorPil.from_pretrained(str(folder), local_files_only=True)
            self._tokenizer: Any = CLIPTokenizer.from_pretrained(str(folder), local_files_only=True)
        except (OSError, ValueError, KeyError, RuntimeError) as error:
            reason = " ".join(str(error).split())[:200]
            raise StageError(f"CLIP: {folder} lacks its image processor or tokenizer: {reason}.") from error
        self.name = name
        self.temperature = float(np.exp(-self._model.logit_scale.item()))

    def pictures(self, pictures: Sequence[NDArray[np.uint8]]) -> NDArray[np.float32]:
        """Unit vectors of pictures of shape [H, W, 3], any sizes; shape [P, D]."""
        found = []
        for start in range(0, len(pictures), _PICTURES_AT_ONCE):
            batch = self._processor(images=list(pictures[start : start + _PICTURES_AT_ONCE]), return_tensors="pt")
            found.append(self._unit(self._model.get_image_features, pixel_values=batch["pixel_values"]))
        return np.concatenate(found)

    def sentences(self, sentences: Sequence[str]) -> NDArray[np.float32]:
        """Unit vectors of sentences; shape [S, D]."""
        found = []
        for start in range(0, len(sentences), _SENTENCES_AT_ONCE):
            tokens = self._tokenizer(
                list(sentences[start : start + _SENTENCES_AT_ONCE]),
                padding=True, truncation=True, max_length=_MAX_TOKENS, return_tensors="pt",
            )  # fmt: skip
            inputs = {key: tokens[key] for key in ("input_ids", "attention_mask")}
            found.append(self._unit(self._model.get_text_features, **inputs))
        return np.concatenate(found)

    def _unit(self, embed: Any, **inputs: Any) -> NDArray[np.float32]:
        import torch  # pyright: ignore[reportMissingImports]

        with torch.inference_mode():
            out = embed(**{name: tensor.to(self._model.device) for name, tensor in inputs.items()})
            vectors = getattr(out, "pooler_output", out).float().cpu().numpy()
        return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)
