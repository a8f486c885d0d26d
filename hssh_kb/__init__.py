"""Large-scale space: experience, axioms, hypotheses, layout, and the questions one asks of them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hssh_kb.kb import KnowledgeBase

__all__ = ["KnowledgeBase"]


def __getattr__(name: str) -> Any:  # noqa: ANN401
    """Import on demand, so that ``import hssh_kb`` stays quick."""
    if name == "KnowledgeBase":
        from hssh_kb.kb import KnowledgeBase

        return KnowledgeBase
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
