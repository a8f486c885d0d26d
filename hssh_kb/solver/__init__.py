"""The one seam to clingo: programs in, plain Python out, with budgets in models and seconds."""

from hssh_kb.solver.assuming import AssumingSolver
from hssh_kb.solver.deriving import Step, derive_all
from hssh_kb.solver.minimal import solve_minimal
from hssh_kb.solver.reading import (
    Term,
    answer_query,
    check_rules,
    parse_facts,
    read_term,
    show_term,
)
from hssh_kb.solver.refuting import Atom, solve_best_refuting
from hssh_kb.solver.solving import (
    Control,
    Models,
    Symbol,
    ground,
    is_satisfiable,
    solve_all,
    solve_best,
)

__all__ = [
    "AssumingSolver",
    "Atom",
    "Control",
    "Models",
    "Step",
    "Symbol",
    "Term",
    "answer_query",
    "check_rules",
    "derive_all",
    "ground",
    "is_satisfiable",
    "parse_facts",
    "read_term",
    "show_term",
    "solve_all",
    "solve_best",
    "solve_best_refuting",
    "solve_minimal",
]
