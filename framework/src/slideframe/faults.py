"""What is wrong with the content of a model, in words: the key, the rule that it breaks, and what it takes instead."""

import difflib
from collections.abc import Iterable, Mapping
from typing import Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from slideframe.problem import kind_of, models_of

BOUNDS = (("gt", "more than"), ("ge", "at least"), ("lt", "less than"), ("le", "at most"))


def describe(model: type[BaseModel], fault: Mapping[str, Any]) -> str:
    """Return one line on a fault that pydantic found, with the nearest known key where a key is unknown."""
    location = [str(part) for part in fault["loc"]]
    key = _key(model, location)
    if fault["type"] == "extra_forbidden":
        parent = _model_at(model, location[:-1])
        known = sorted(parent.model_fields) if parent else []
        near = difflib.get_close_matches(location[-1], known, n=1)
        return f"{key}: unknown key" + (f", did you mean '{near[0]}'?" if near else f"; known are {', '.join(known)}")
    if fault["type"] == "union_tag_invalid":
        return f"{key}: kind {fault['ctx']['tag']!r} is none of {fault['ctx']['expected_tags']}"
    if fault["type"] == "union_tag_not_found":
        return f"{key}: a table with its kind is wanted, as in {key} = {{kind = ...}} (got {fault['input']!r})"
    if fault["type"] == "missing":
        return f"{key}: required but absent"
    # what breaks a rule that joins keys is a whole table, which says nothing
    got = "" if isinstance(fault["input"], Mapping) else f" (got {fault['input']!r})"
    return f"{key}: {fault['msg'].removeprefix('Value error, ')}{got}"


def cure(model: type[BaseModel], faults: Iterable[Mapping[str, Any]]) -> str:
    """Return what the faulty keys take, as far as they are known."""
    rules: dict[str, None] = {}
    for fault in faults:
        location = [str(part) for part in fault["loc"]]
        parent = _model_at(model, location[:-1]) if location else None
        if parent and location[-1] in parent.model_fields and (takes := _takes(parent.model_fields[location[-1]])):
            rules[f"{_key(model, location)} takes {takes}"] = None
    return "; ".join([*rules, "see `slideframe schema`"])


def _takes(field: FieldInfo) -> str:
    """Return a field's bounds and meaning."""
    bounds = " and ".join(
        f"{words} {getattr(rule, name):g}" for rule in field.metadata for name, words in BOUNDS if hasattr(rule, name)
    )
    return ": ".join(part for part in (bounds, field.description) if part) if bounds else ""


def _key(model: type[BaseModel], location: list[str]) -> str:
    return ".".join(_without_members(model, location)) or "the whole"


def _without_members(model: type[BaseModel], location: list[str]) -> list[str]:
    """Leave out the parts of a location that name the member of a union, which no key does."""
    kept: list[str] = []
    members = [model]
    for part in location:
        chosen = [member for member in members if kind_of(member) == part and part not in member.model_fields]
        if chosen and kept:
            members = chosen
            continue
        kept.append(part)
        members = [
            inner
            for member in members
            if part in member.model_fields
            for inner in models_of(member.model_fields[part].annotation)
        ]
    return kept


def _model_at(model: type[BaseModel], location: list[str]) -> type[BaseModel] | None:
    """Return the model of the table at a location, if it's one."""
    members = [model]
    for part in location:
        if part.isdigit():  # a place in a list
            continue
        if part in model.model_fields:
            members = models_of(model.model_fields[part].annotation)
        else:  # the member of a union
            members = [member for member in members if kind_of(member) == part]
        if not members:
            return None
        model = members[0]
    return model
