"""The errors a user can meet, one base class, each with its exit code."""

from __future__ import annotations


class HsshError(Exception):
    """Base of all errors that are told to the user in one message, without a traceback."""

    exit_code: int = 70


class InputError(HsshError, ValueError):
    """The input is wrong: says where, what was expected and what to do."""

    exit_code = 3


class NoAnswerError(HsshError):
    """The question was understood and the answer is "no": no route, no such map."""

    exit_code = 1


class UsageError(HsshError):
    """The command was called in a way that has no meaning."""

    exit_code = 2


class BudgetError(HsshError):
    """The time or model budget ran out before there was an answer."""

    exit_code = 4


class InternalError(HsshError):
    """Our own fault."""

    exit_code = 70
