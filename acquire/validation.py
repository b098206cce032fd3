"""What pydantic found, in words for a person."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, ValidationError

MAX_SHOWN = 8


class StrictModel(BaseModel):
    """What a person or a file hands over: unchangeable, no unknown keys, only finite numbers."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


def explain(error: ValidationError) -> str:
    """One line for each problem: the key and the reason."""
    lines = []
    for problem in error.errors(include_url=False, include_context=False)[:MAX_SHOWN]:
        key = ".".join(str(part) for part in problem["loc"]) or "(whole file)"
        reason = problem["msg"].removeprefix("Value error, ")
        if problem["type"] == "extra_forbidden":
            reason = "there is no such key; see `lumisplit plan --example` or the README"
        lines.append(f"  {key}: {reason}")
    left_out = error.error_count() - len(lines)
    return "\n".join([*lines, *([f"  and {left_out} more"] if left_out > 0 else [])])
