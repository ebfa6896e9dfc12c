"""What all problem models share."""

from typing import Annotated, Any, get_args

from pydantic import BaseModel, ConfigDict, Discriminator, Field

Vector = tuple[float, float, float]
Share = Annotated[float, Field(ge=0, le=1)]


class ProblemModel(BaseModel):
    """Base of every problem model: immutable, no unknown keys, no infinities."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


def models_of(annotation: Any) -> list[type[BaseModel]]:
    """Return the models that a field's annotation admits: itself, or the members of its union."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for part in get_args(annotation) for model in models_of(part)]


def kind_of(model: type[BaseModel]) -> str:
    """Return the `kind` by which a model is told apart from the other members of its union, or nothing."""
    kind = model.model_fields.get("kind")
    kinds = get_args(kind.annotation) if kind else ()
    return str(kinds[0]) if len(kinds) == 1 else ""


def kind_or(default: str) -> Discriminator:
    """Tell the members of a closed union apart by their `kind`, which may be left out for the usual one."""

    def tell(value: Any) -> str | None:
        kind = value.get("kind", default) if isinstance(value, dict) else getattr(value, "kind", None)
        return None if kind is None else str(kind)

    return Discriminator(tell)
