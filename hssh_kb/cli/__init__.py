"""The command line ``hssh``: a thin skin over :class:`hssh_kb.kb.KnowledgeBase`.

stdout is the answer only; progress, notices and errors go to stderr. Exit codes: 0 yes or found,
1 answered "no", 2 usage, 3 bad input, 4 budget spent, 70 our fault.
"""

from hssh_kb.cli.entry import main, main_and_exit

__all__ = ["main", "main_and_exit"]
