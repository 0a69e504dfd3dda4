"""Turns pydantic's report on a scene into one readable sentence with file, line, key and the way out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, get_args, get_origin

from pydantic import BaseModel, ValidationError

from phys4dgen.errors import did_you_mean

__all__ = ["explain"]

_EXPECTED = {
    "greater_than": "a number greater than {gt:g}",
    "greater_than_equal": "a number of at least {ge:g}",
    "less_than": "a number less than {lt:g}",
    "less_than_equal": "a number of at most {le:g}",
    "literal_error": "{expected}",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "float_type": "a number",
    "finite_number": "a finite number",
    "bool_type": "true or false",
    "string_type": "text",
    "is_instance_of": "a file name",
    "path_type": "a file name",
    "tuple_type": "a list",
    "dict_type": "a mapping",
    "model_type": "a mapping",
    "union_tag_not_found": "a mapping",
    "string_pattern_mismatch": "a name of letters, digits, '_', '-' and spaces",
}


def explain(
    error: ValidationError, model: type[BaseModel], *, source: str, places: Mapping[tuple[Any, ...], str]
) -> str:
    """One sentence on the first problem of ``error``, and how many more there are.

    Args:
        error: what pydantic found.
        model: the root model that was validated.
        source: the file that the values come from.
        places: file and line, or flag, of each value by its keys from the root; may be empty.
    """
    problems: dict[tuple[Any, ...], list[Any]] = {}
    parents: dict[tuple[Any, ...], Any] = {}
    for item in error.errors(include_url=False):
        path, parent = _key_path(item["loc"], model)
        if item["type"] == "union_tag_invalid":
            path, item = (*path, "kind"), _unknown_kind(item)
        problems.setdefault(path, []).append(item)
        parents[path] = parent
    # A misspelt key is the cause of a missing one, so it goes first.
    path, items = min(problems.items(), key=lambda problem: problem[1][0]["type"] != "extra_forbidden")
    place = next((places[path[:n]] for n in range(len(path), 0, -1) if path[:n] in places), source)
    more = f" (And {len(problems) - 1} more to correct.)" if len(problems) > 1 else ""
    return f"{place}: {_sentence(path, items, parents[path])}{more}"


def _unknown_kind(item: Any) -> Any:
    """The report on an unknown ``kind`` as if it were one on an unknown choice."""
    kind = item["input"].get("kind") if isinstance(item["input"], Mapping) else item["input"]
    return {"type": "literal_error", "input": kind, "ctx": {"expected": item["ctx"]["expected_tags"]}}


def _sentence(path: tuple[Any, ...], items: list[Any], parent: Any) -> str:
    key = ".".join(map(str, path))
    kinds = {item["type"] for item in items}
    if kinds == {"extra_forbidden"}:
        known = list(parent.model_fields) if _is_model(parent) else []
        hint = did_you_mean(str(path[-1]), known) or f" Known keys here: {', '.join(known)}."
        return f"'{key}' is not a key of a scene.{hint}"
    if kinds == {"missing"}:
        return f"'{key}' is missing; add it."
    if "value_error" in kinds:
        text = next(item["msg"] for item in items if item["type"] == "value_error").removeprefix("Value error, ")
        return f"{key}: {text}." if key else f"{text}."
    expected = " or ".join(dict.fromkeys(_expected(item) for item in items))
    got = items[0]["input"]
    hint = did_you_mean(got, _choices(items)) if isinstance(got, str) and got else ""
    return f"{key}: expected {expected}, got {_shown(got)}.{hint}"


def _expected(item: Any) -> str:
    template = _EXPECTED.get(item["type"])
    return template.format(**item.get("ctx", {})) if template else item["msg"][:1].lower() + item["msg"][1:]


def _choices(items: list[Any]) -> list[str]:
    literal = next((item["ctx"]["expected"] for item in items if item["type"] == "literal_error"), "")
    return [word.strip("' ") for word in literal.replace(" or ", ", ").split(",") if word]


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _key_path(loc: tuple[Any, ...], model: type[BaseModel]) -> tuple[tuple[Any, ...], Any]:
    """The keys of the scene in pydantic's location, without the union members that it adds, and what holds the last."""
    path: list[Any] = []
    here: Any = model
    parent: Any = None
    for step in loc:
        if here is None:
            break
        member = _member(here, step)
        if member is not None:
            here = member
            continue
        path.append(step)
        parent, here = here, _below(here, step)
    return tuple(path), parent


def _member(annotation: Any, tag: Any) -> Any:
    """The model of a union whose ``kind`` is ``tag``, else None."""
    models = _models(annotation)
    return next((m for m in models if len(models) > 1 and m.model_fields["kind"].default == tag), None)


def _models(annotation: Any) -> list[Any]:
    """The models that a value may be: itself, or the members of a union."""
    if _is_model(annotation):
        return [annotation]
    if get_origin(annotation) in (tuple, dict, list):
        return []
    return [model for argument in get_args(annotation) for model in _models(argument)]


def _below(annotation: Any, step: Any) -> Any:
    """What stands under a key: a model, a union of some, a collection that holds them, or None."""
    if _is_model(annotation):
        field = annotation.model_fields.get(step)
        return _container(field.annotation) if field is not None else None
    return next((argument for argument in get_args(annotation) if _models(argument)), None)


def _container(annotation: Any) -> Any:
    """The annotation where keys or positions follow below it (a model, a mapping, a list of models), else None."""
    origin = get_origin(annotation)
    if origin not in (tuple, dict) and len(models := _models(annotation)) == 1:
        return models[0]  # a section that may be left out
    is_list_of_models = origin is tuple and any(_models(argument) for argument in get_args(annotation))
    return annotation if _models(annotation) or origin is dict or is_list_of_models else None


def _is_model(annotation: Any) -> bool:
    return isinstance(annotation, type) and issubclass(annotation, BaseModel)
