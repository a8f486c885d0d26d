"""The errors of the project, gathered under one name; see :mod:`perception.errors`."""

from perception.errors import (
    BudgetError,
    HsshError,
    InputError,
    InternalError,
    NoAnswerError,
    UsageError,
)

__all__ = [
    "BudgetError",
    "HsshError",
    "InputError",
    "InternalError",
    "NoAnswerError",
    "UsageError",
]
