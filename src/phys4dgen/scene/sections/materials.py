"""Section ``materials``: who names the materials."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from phys4dgen.scene.address import checked_address
from phys4dgen.scene.sections.values import Auto, FilePath, Section, as_tuple

__all__ = ["Materials"]


class Materials(Section):
    """Who names the materials (Paper: Sec. 3.4)."""

    backend: Literal["auto", "mllm", "clip", "command", "rule", "library", "file"] = "auto"
    """auto: file where given, else mllm where allow_upload is true, else rule (stand-in for the language model); clip:
    which of the library's materials each part looks like; command: the program argv; library: parts bear the names of
    materials"""
    file: FilePath | None = None
    """a materials.yaml; its entries win over backend, and parts.NAME.material over them"""
    model: Annotated[str, Field(min_length=1, max_length=128)] = "gpt-4o"
    """of mllm: id of a multimodal model (the paper's by default)"""
    base_url: Annotated[str, AfterValidator(checked_address)] = "https://api.openai.com/v1"
    """of mllm: address of an OpenAI-compatible endpoint; keys are environment variables (OPENAI_API_KEY,
    GEMINI_API_KEY, for other servers PHYS4DGEN_MLLM_KEY) and never stand here"""
    allow_upload: bool = False
    """of mllm: pictures of the object may leave this machine"""
    offline: bool = False
    """of mllm: use the answers in the run folder alone"""
    samples: Annotated[int, Field(ge=1, le=200)] = 5
    """of mllm: independent answers, from which a vote and medians are taken"""
    temperature: Annotated[float, Field(ge=0, le=2)] = 0.8
    """of mllm: how much the answers may differ"""
    trust: bool = False
    """of mllm: keep its values although the library or the rule table speaks against them"""
    origin: Literal["ask", "natural", "artificial"] = "ask"
    """of mllm: whether the object grew or was made, where you know it; decides between model and rule table"""
    max_tokens: Auto | Annotated[int, Field(ge=1000, le=100_000_000)] = "auto"
    """of mllm: bound on the tokens of all answers together; auto: 40,000 per sample"""
    max_requests: Auto | Annotated[int, Field(ge=1, le=10_000)] = "auto"
    """of mllm: bound on the requests, retries included; auto: 4 per sample"""
    max_wait_s: Annotated[float, Field(gt=0, le=3600)] = 180.0
    """of mllm: bound on the time of all answers together"""
    argv: Annotated[tuple[str, ...], BeforeValidator(as_tuple)] = ()
    """of command: program and arguments, {run} for the run folder, {parts} for the names of the parts, {out} for the
    materials.yaml to write; no shell"""
    timeout_s: Annotated[float, Field(gt=0, le=86_400)] = 1800.0
    """of command: it is ended after this time"""

    @model_validator(mode="after")
    def _backend_has_its_file(self) -> Materials:
        if self.backend == "file" and self.file is None:
            raise ValueError("backend 'file' needs file; name a materials.yaml, or choose backend 'auto'")
        return self

    @model_validator(mode="after")
    def _command_has_its_words(self) -> Materials:
        if self.backend == "command" and not any("{out}" in word for word in self.argv[1:]):
            raise ValueError("backend 'command' needs argv, a program and its arguments with {run} and {out}")
        if self.backend != "command" and self.argv:
            raise ValueError(f"argv is given but backend is '{self.backend}'; choose 'command'")
        return self
